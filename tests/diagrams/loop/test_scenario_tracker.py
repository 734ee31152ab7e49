from pathlib import Path

import pytest

from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.scenario.load import LoadScenario
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import InvalidValueError, MissingDependencyError, ScenarioError
from poil_drake.perception.trackers.learned import clip_tracker
from poil_drake.perception.trackers.learned.config import MvTrackerConfig
from poil_drake.perception.trackers.lucas_kanade import LucasKanadeConfig
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig

TEST_FILE = Path(__file__).parents[1] / "scenarios.yaml"


def poil(keys: str = "") -> PoilConfig:
    """Returns a scenario's section with parameters of all trackers, changed by keys."""
    data = f"{{poil: {{num_support_points: 30, {keys}}}}}"
    return LoadScenario(filename=TEST_FILE, scenario_name="OneOfEverything", data=data).poil


def test_the_default_tracker_has_its_parameters_from_the_scenario() -> None:
    dut = MakeScenarioTracker(poil())

    expected = RigidFlowConfig(aligned_points=1000, prior_angular_speed=0.2, support_points=30)
    assert dut.config == expected  # type: ignore[attr-defined]


def test_another_tracker_has_its_own_parameters() -> None:
    dut = MakeScenarioTracker(poil("tracker: lucas_kanade"))

    expected = LucasKanadeConfig(window=15, levels=4, support_points=30)
    assert dut.config == expected  # type: ignore[attr-defined]


def test_a_learned_tracker_has_absolute_paths_and_the_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(clip_tracker, "check_environment", lambda config: "")

    dut = MakeScenarioTracker(poil("tracker: mvtracker, table_height: 0.7"))

    folder = TEST_FILE.parent
    assert dut.config == MvTrackerConfig(  # type: ignore[attr-defined]
        python=str(folder / "mvtracker/.venv/bin/python"),
        repository=str(folder / "mvtracker"),
        weights=str(folder / "main.pth"),
        support_points=30,
        table_height=0.7,
    )


@pytest.mark.parametrize(
    ("keys", "error", "says"),
    [
        ("tracker: mvtracer", InvalidValueError, "no point tracker 'mvtracer'"),
        ("tracker: cotracker3", MissingDependencyError, "CoTracker3 is not installed"),
        (
            "tracker_config: {rigid_flow: {support_points: 4}}",
            ScenarioError,
            r"'support_points' in 'poil\.tracker_config\.rigid_flow' is not known",
        ),
        (
            "tracker_config: {mvtracker: {timeout: 0}}",
            ScenarioError,
            r"poil\.tracker_config\.mvtracker\.timeout is 0\.0",
        ),
    ],
)
def test_mistakes_are_named(keys: str, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        MakeScenarioTracker(poil(keys))
