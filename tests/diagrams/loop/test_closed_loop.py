"""What building and closing the loop starts and ends."""

import dataclasses
from pathlib import Path

import pytest
from pydrake.systems.analysis import Simulator
from short_skill import short_plan, short_scenario

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.scenario.choice import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import InvalidValueError, ScenarioError, StationError
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
