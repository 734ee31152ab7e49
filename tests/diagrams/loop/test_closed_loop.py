"""What building and closing the loop starts and ends."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem
from pydrake.systems.sensors import ImageRgba8U
from short_skill import short_plan, short_scenario

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.scenario.choice import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import InvalidValueError, ScenarioError, StationError
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum
from poil_drake.systems.tracking.recorded_tracker import RecordedTracker


def children() -> set[int]:
    """Returns the processes that this one has started and that have not ended."""
    return {
        int(pid)
        for task in Path("/proc/self/task").iterdir()
        for pid in (task / "children").read_text().split()
    }


def with_poil(scenario: Scenario, **changed: object) -> Scenario:
    return dataclasses.replace(scenario, poil=dataclasses.replace(scenario.poil, **changed))


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
        MakeClosedLoop(with_poil(ChooseScenario(), detector="magic"), short_plan())

    assert children() <= before


def test_a_tracker_of_images_needs_cameras() -> None:
    blind = with_poil(short_scenario(), tracker="rigid_flow")

    with pytest.raises(ScenarioError, match=r"names none.*ground_truth"):
        MakeClosedLoop(blind, short_plan())


def test_the_ground_truth_may_be_faster_than_the_cameras() -> None:
    scenario = with_poil(ChooseScenario(), tracker="ground_truth", latency=1 / 32)

    with MakeClosedLoop(scenario, short_plan()) as loop:
        assert loop.detector is None


def test_a_tracker_without_frames_leaves_an_album_empty() -> None:
    scenario, plan, album = short_scenario(), short_plan(), SnapshotAlbum()
    tracker = RecordedTracker(tracks=(), num_points=len(plan.target_points), period=1 / 256)
    with_images = with_poil(scenario, tracker="rigid_flow")

    with MakeClosedLoop(with_images, plan, tracker=tracker, album=album) as loop:
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
