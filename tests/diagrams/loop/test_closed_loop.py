"""What building and closing the loop starts and ends."""

import dataclasses
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem
from pydrake.systems.sensors import ImageRgba8U
from short_skill import short_plan

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import InvalidValueError, ScenarioError, StationError
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum
from poil_drake.systems.tracking.recorded_tracker import RecordedTracker


def children() -> set[int]:
    """Returns the processes that this one has started and that have not ended."""
    found: set[int] = set()
    for task in Path("/proc/self/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # The thread has just ended.
            found |= set(map(int, (task / "children").read_text().split()))
    return found


@pytest.mark.render
def test_a_with_block_ends_the_processes_that_were_started() -> None:
    before = children()

    with MakeClosedLoop(ChooseScenario(), short_plan()) as loop:
        started = children() - before
        Simulator(loop.diagram).AdvanceTo(0.25)

    assert len(started) == 2, "one renders, one tracks"
    assert children() <= before
    with pytest.raises(StationError, match="has been closed"):
        Simulator(loop.diagram).AdvanceTo(0.25)


@pytest.mark.render
def test_a_loop_that_cannot_be_built_leaves_no_process() -> None:
    before = children()

    with pytest.raises(InvalidValueError, match="magic"):
        MakeClosedLoop(ChooseScenario(detector="magic"), short_plan())

    assert children() <= before


def test_a_tracker_of_images_needs_cameras() -> None:
    blind = dataclasses.replace(ChooseScenario(), cameras={})

    with pytest.raises(ScenarioError, match=r"has none.*ground_truth"):
        MakeClosedLoop(blind, short_plan())


def test_the_ground_truth_may_be_faster_than_the_cameras() -> None:
    scenario = ChooseScenario(data="{poil: {tracker: ground_truth, latency: 1/32}}")

    with MakeClosedLoop(scenario, short_plan()) as loop:
        assert loop.detector is None


def test_a_tracker_without_frames_leaves_an_album_empty() -> None:
    scenario, plan, album = ChooseScenario(), short_plan(), SnapshotAlbum()
    tracker = RecordedTracker(tracks=(), num_points=len(plan.target_points), period=1 / 256)

    with MakeClosedLoop(scenario, plan, tracker=tracker, album=album) as loop:
        Simulator(loop.diagram).AdvanceTo(0.25)

    assert album.snapshots == ()


class ImageTracker(LeafSystem):
    """A user's tracker, which never finds anything."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareAbstractInputPort("left.rgb_image", Value(ImageRgba8U()))
        self.DeclareVectorInputPort("object_motion", 16)
        for port, size in (("status", 1), ("times", 3)):
            self.DeclareStateOutputPort(port, self.DeclareDiscreteState(size))
        lost = Value(TrackedPoints.lost(10, -np.inf))
        self.DeclareStateOutputPort("tracked_points", self.DeclareAbstractState(lost))


@pytest.mark.render
def test_a_users_tracker_of_images_gets_the_motion_at_their_time() -> None:
    with MakeClosedLoop(ChooseScenario(), short_plan(), tracker=ImageTracker()) as loop:
        context = loop.diagram.CreateDefaultContext()
        ports = {
            port: system.GetInputPort(port).HasValue(system.GetMyContextFromRoot(context))
            for system, port in (
                (loop.tracker, "left.rgb_image"),
                (loop.tracker, "object_motion"),
                (loop.propagator, "image_time"),
            )
        }

    assert all(ports.values()), ports
