"""What a viewer sees of the real closed loop: on the live page, and in the recording of a run."""

import dataclasses
from pathlib import Path

import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.run.html_recording import MakeMeshcat
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.systems.visualization.point_set_visualizer import PointSetVisualizerConfig

pytestmark = [pytest.mark.browser, pytest.mark.slow]

FOLLOWING = 7.0  # [s] A time in the phase in which the field drives the mug.
DRAWN = {
    # Path below /drake                 fewest pixels
    "illustration/panda": 5000,
    "illustration/mug": 300,
    "poil/reference": 100,
    "poil/points": 30,
    "poil/tracked_points": 30,
}


def check_all_is_drawn(page) -> None:
    inside = "poil/tracked_points"  # Inside the points, unless these have moved since the images.
    seen = page.appearances([path for path in DRAWN if path != inside])
    page.set_visible("poil/points", False)
    seen[inside] = page.appearance(inside)
    page.set_visible("poil/points", True)
    assert {path: seen[path].pixels for path in DRAWN if seen[path].pixels < DRAWN[path]} == {}
    hue = seen["poil/points"].share_of_hue(PointSetVisualizerConfig().point_color[:3])
    assert hue > 0.5


def test_the_live_page_draws(page, plan: ExecutionPlan, scenario: Scenario) -> None:
    meshcat = MakeMeshcat()
    poil = dataclasses.replace(scenario.poil, tracker="ground_truth")
    with MakeClosedLoop(dataclasses.replace(scenario, poil=poil), plan, meshcat=meshcat) as loop:
        Simulator(loop.diagram).AdvanceTo(0.5)  # The first track is available.

        page.open(meshcat.web_url())
        page.wait_for_objects(DRAWN)
        check_all_is_drawn(page)
        page.leave()


@pytest.fixture
def recording(page, whole_run: Path):
    """The page of a whole run."""
    page.open_once(whole_run / "run.html")
    page.wait_for_objects(DRAWN)
    return page


def test_the_recording_draws(recording) -> None:
    recording.seek(FOLLOWING)

    check_all_is_drawn(recording)


def test_the_recording_moves_the_mug(recording) -> None:
    recording.seek(0.0)
    before = recording.appearance("illustration/mug").centre
    recording.seek(FOLLOWING)
    after = recording.appearance("illustration/mug").centre
    # The mug is lifted by some centimetres, at about 500 pixels a metre.
    assert after[1] < before[1] - 10
