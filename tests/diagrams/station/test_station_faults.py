"""The faults of a scenario in the simulated station."""

from pathlib import Path

import numpy as np
import pytest

from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import InvalidValueError, ScenarioError

TEST_FILE = Path(__file__).parents[1] / "scenarios.yaml"


def test_pictures_of_the_scene_have_the_faults_of_their_time() -> None:
    faults = (
        "!LightChange {camera: left, gain: [0, 0, 0]}",
        "!LightChange {camera: right, gain: [0, 0, 0], start: 1}",
        "!TransparentObject {camera: right, share: 1}",
        "!ExtrinsicsError {camera: right, translation: [0.01, 0, 0]}",
    )
    scenario = ChooseScenario(data=f"{{poil: {{faults: [{', '.join(faults)}]}}}}")
    dut = MakeStation(scenario, ignore_output_delay=True)

    frame = CaptureFrame(dut, dut.CreateDefaultContext(), labels=True)

    left, right = frame.images
    assert not left.rgb.any()
    assert right.rgb.any()
    assert right.label is not None
    assert not right.depth[np.isin(right.label, frame.label_ids["mug"])].any()
    true = MakeStation(ChooseScenario(), ignore_output_delay=True).camera_models
    shifts = [np.linalg.norm(a.X_WC - b.X_WC) for a, b in zip(frame.cameras, true, strict=True)]
    assert shifts == pytest.approx([0.0, 0.01])


def test_cameras_without_a_delay_deliver_no_faults() -> None:
    scenario = LoadScenario(
        filename=TEST_FILE,
        scenario_name="OneOfEverything",
        data="{poil: {faults: [!FrozenFrames {start: 1}]}}",
    )

    with pytest.raises(ScenarioError, match="needs cameras with an output_delay"):
        MakeStation(scenario)


def test_a_fault_of_an_unknown_camera_is_refused() -> None:
    scenario = ChooseScenario(data="{poil: {faults: [!FrozenFrames {camera: top}]}}")

    with pytest.raises(InvalidValueError, match="the camera 'top'"):
        MakeStation(scenario)
