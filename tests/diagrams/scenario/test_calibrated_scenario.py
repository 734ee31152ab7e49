"""Scenarios whose key `poil.calibration` names a file of camera poses."""

from pathlib import Path

import numpy as np
import pytest

from poil_drake.diagrams.scenario.load import LoadScenario
from poil_drake.errors import ScenarioError


@pytest.fixture
def calibrated(tmp_path: Path) -> Path:
    """A scenario with two cameras and the calibration `poses.yaml` beside it."""
    path = tmp_path / "cell.yaml"
    path.write_text(
        "Cell: {cameras: {left: {name: left, width: 320}, right: {name: right}}, "
        "poil: {calibration: poses.yaml}}"
    )
    return path


def test_a_calibration_replaces_the_poses_and_nothing_else(calibrated: Path) -> None:
    calibrated.with_name("poses.yaml").write_text(
        "cameras: {left: {X_PB: {translation: [1, 2, 3], rotation: !Rpy {deg: [0, 0, 90]}}}}"
    )

    dut = LoadScenario(filename=calibrated)

    pose = dut.cameras["left"].X_PB.GetDeterministicValue()
    np.testing.assert_allclose(pose.GetAsMatrix4()[:3, [0, 3]], [[0, 1], [1, 2], [0, 3]], atol=1e-9)
    assert dut.cameras["left"].width == 320
    assert dut.cameras["right"].X_PB.GetDeterministicValue().IsExactlyIdentity()
    # A log of a run holds the poses, not the name of a file that may change.
    assert dut.poil.calibration == ""


def test_text_may_name_a_calibration_and_change_its_poses_later(calibrated: Path) -> None:
    calibrated.with_name("poses.yaml").write_text(
        "cameras: {left: {X_PB: {translation: [1, 2, 3]}}}"
    )

    moved = "{cameras: {left: {X_PB: {translation: [4, 5, 6]}}}}"
    dut = LoadScenario(filename=calibrated, data=moved)

    np.testing.assert_array_equal(dut.cameras["left"].X_PB.translation, [4, 5, 6])


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (None, r"poses\.yaml', which is not a file of camera poses"),
        ("", r"poses\.yaml', which is not a file of camera poses"),
        ("Cell: {cameras: {left: {width: 1}}}", "which is not a file of camera poses"),
        ("{cameras: {top: {}}}", "has the camera 'top', but the scenario does not.*left, right"),
        ("{cameras: {left: {X_BP: {}}}}", "'X_BP' in 'cameras.left' is not known"),
    ],
)
def test_a_wrong_calibration_is_refused(calibrated: Path, text: str | None, problem: str) -> None:
    if text is not None:
        calibrated.with_name("poses.yaml").write_text(text)

    with pytest.raises(ScenarioError, match=problem):
        LoadScenario(filename=calibrated)
