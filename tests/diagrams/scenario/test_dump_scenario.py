import dataclasses
from pathlib import Path

import pytest

from poil_drake.diagrams.scenario.load import (
    ChooseScenario,
    DumpScenario,
    LoadScenario,
    default_scenario_file,
)
from poil_drake.diagrams.scenario.scenario import Scenario, ScenarioSource
from poil_drake.errors import ScenarioError
from poil_drake.perception.capture.config import RealSense

TEST_FILE = Path(__file__).parents[1] / "scenarios.yaml"


def again(scenario: Scenario, folder: Path) -> Scenario:
    """Returns the scenario after writing it to a file in another folder and reading it."""
    path = folder / "dumped.yaml"
    path.write_text(DumpScenario(scenario))
    return LoadScenario(filename=path)


@pytest.mark.parametrize("name", ["Defaults", "OneOfEverything"])
def test_a_dumped_scenario_is_the_same_when_loaded(name: str, tmp_path: Path) -> None:
    scenario = LoadScenario(filename=TEST_FILE, scenario_name=name)

    dut = again(scenario, tmp_path)

    assert dut.source.name == name
    # Drake's types have no equality; their text is compared instead.
    assert DumpScenario(dut) == DumpScenario(scenario)
    for field in ("random_seed", "simulation_duration", "model_drivers", "poil"):
        assert getattr(dut, field) == getattr(scenario, field)


def test_choices_are_dumped(tmp_path: Path) -> None:
    cameras = "{cameras: {left: !RealSense {serial: '0123'}}}"
    scenario = ChooseScenario(
        seed=3, tracker="ground_truth", data=f"{{poil: {{eta: 1.75, hardware: {cameras}}}}}"
    )

    dut = again(scenario, tmp_path)

    assert dut.poil == scenario.poil
    assert dut.poil.hardware.cameras["left"] == RealSense(serial="0123")
    assert (dut.poil.tracker, dut.poil.eta) == ("ground_truth", 1.75)
    assert dut.random_seed == scenario.random_seed != 0
    mug, drawn = dut.directives[-1].add_model, scenario.directives[-1].add_model
    assert mug.file == drawn.file
    pose, drawn_pose = mug.default_free_body_pose["body"], drawn.default_free_body_pose["body"]
    # To the last bit: a repeated run must start at the same pose.
    assert pose.translation.tolist() == drawn_pose.translation.tolist()
    turn, drawn_turn = (p.GetDeterministicValue().rotation() for p in (pose, drawn_pose))
    assert turn.matrix().tolist() == drawn_turn.matrix().tolist()
    assert dut.cameras["left"].renderer_class.backend == "EGL"


def test_the_order_of_cameras_is_kept(tmp_path: Path) -> None:
    scenario = ChooseScenario()
    cameras = {name: scenario.cameras[name] for name in ("right", "left")}

    dut = again(dataclasses.replace(scenario, cameras=cameras), tmp_path)

    assert list(dut.cameras) == ["right", "left"]


def test_the_source_of_a_scenario_is_known(tmp_path: Path) -> None:
    file = default_scenario_file()
    in_code = again(dataclasses.replace(Scenario(), random_seed=4), tmp_path)

    assert LoadScenario(filename=file).source == ScenarioSource(name="HangMug", file=str(file))
    assert LoadScenario(data="{random_seed: 1}").source.name == ""
    assert (in_code.source.name, in_code.random_seed) == ("Scenario", 4)


def test_the_source_of_a_scenario_is_no_key() -> None:
    with pytest.raises(ScenarioError, match="'source' is not known"):
        LoadScenario(data="{source: {name: Other}}")
