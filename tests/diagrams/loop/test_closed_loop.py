"""What building and closing the loop starts and ends."""

import dataclasses
from contextlib import suppress
from pathlib import Path

import pytest
from pydrake.systems.analysis import Simulator
from short_skill import short_plan

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import InvalidValueError, ScenarioError, StationError


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
