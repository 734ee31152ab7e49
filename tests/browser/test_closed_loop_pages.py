"""What a viewer sees of a real closed loop: on the live page, and in the recording of the run."""

import dataclasses

import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.diagrams.closed_loop import MakeClosedLoop
from poil_drake.diagrams.html_recording import HtmlRecording, MakeMeshcat
from poil_drake.diagrams.scenario import Scenario
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.systems.point_set_visualizer import PointSetVisualizerConfig

pytestmark = [pytest.mark.browser, pytest.mark.slow]

DURATION = 7.0  # [s]: into the phase in which the field drives the mug.
DRAWN = {
    # Path below /drake                 fewest pixels that must be its own
    "illustration/panda": 5000,
    "illustration/mug": 300,
    "poil/reference": 100,
    "poil/points": 30,
    "poil/tracked_points": 30,
}


@pytest.fixture(scope="module")
def recorded(plan: ExecutionPlan, scenario: Scenario, tmp_path_factory: pytest.TempPathFactory):
    """A short run that was drawn live and recorded: its Meshcat and its HTML file."""
    meshcat = MakeMeshcat()
    poil = dataclasses.replace(scenario.poil, tracker="ground_truth")
    loop = MakeClosedLoop(dataclasses.replace(scenario, poil=poil), plan, meshcat=meshcat)
    path = tmp_path_factory.mktemp("html") / "run.html"
    with HtmlRecording(meshcat, path):
        Simulator(loop.diagram).AdvanceTo(DURATION)
    yield meshcat, path
    loop.Close()


@pytest.mark.parametrize("path", DRAWN)
def test_the_live_page_draws(page, recorded, path: str) -> None:
    meshcat, _ = recorded
    page.open_once(meshcat.web_url())
    page.wait_for_object(path)
    assert page.appearance(path).pixels >= DRAWN[path]


def test_the_points_have_their_colour(page, recorded) -> None:
    meshcat, _ = recorded
    page.open_once(meshcat.web_url())
    page.wait_for_object("poil/points")
    hue = page.appearance("poil/points").share_of_hue(PointSetVisualizerConfig().point_color[:3])
    assert hue > 0.5


@pytest.mark.parametrize("path", DRAWN)
def test_the_recording_draws(page, recorded, path: str) -> None:
    _, file = recorded
    page.open_once(file)
    page.wait_for_object(path)
    page.seek(DURATION - 0.5)
    assert page.appearance(path).pixels >= DRAWN[path]


def test_the_recording_moves_the_mug(page, recorded) -> None:
    _, file = recorded
    page.open_once(file)
    page.wait_for_object("illustration/mug")
    page.seek(0.0)
    before = page.appearance("illustration/mug").centre
    page.seek(DURATION - 0.1)
    after = page.appearance("illustration/mug").centre
    # The mug is lifted by some centimetres, at about 500 pixels a metre.
    assert after[1] < before[1] - 10
