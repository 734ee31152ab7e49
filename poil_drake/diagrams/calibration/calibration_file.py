"""Writes calibrated camera poses as a file for the scenario key `poil.calibration`."""

import time
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.perception.calibration.camera_poses import CalibrationResult
from poil_drake.perception.images import CameraModel
from poil_drake.runtime.output_files import OutputError, whole_file

_FIRST_LINE = "# Camera poses by `poil calibrate cameras`"


def WriteCalibration(
    path: Path,
    scenario: Scenario,
    models: tuple[CameraModel, ...],
    result: CalibrationResult,
) -> None:
    """Writes the poses `X_PB` of all cameras of a scenario.

    Cameras that were not calibrated keep their poses. `X_PB.base_frame` and `X_BC`, the pose of the
    colour camera in the camera's body, are those of the scenario.

    Args:
        path: The file.
        scenario: The scenario whose cameras were calibrated.
        models: The models of the scenario's cameras before calibration.
        result: The new poses.
    """
    source = scenario.source
    lines = [
        f"{_FIRST_LINE}, {time.strftime('%Y-%m-%d %H:%M')}, for {source.name} in {source.file}.",
        f"# To use them, set in the scenario: poil: {{ calibration: {path.name} }}",
        "cameras:",
    ]
    for model in models:
        config = scenario.cameras[model.name]
        found = result.cameras.get(model.name)
        comment, X_WC = "pose kept", model.X_WC
        if found is not None:
            comment, X_WC = f"{found.error_text}; RMS {found.rms:.2f} px", found.X_WC
        # Nothing but the camera's body moves: X_WC = X_WP X_PB X_BC.
        X_BC = config.X_BC.GetDeterministicValue()
        X_PB_before = config.X_PB.GetDeterministicValue()
        X_WP = RigidTransform(model.X_WC) @ X_BC.inverse() @ X_PB_before.inverse()
        # Drake refuses rounding errors.
        R_WC = RotationMatrix.ProjectToRotationMatrix(X_WC[:3, :3])
        X_PB = X_WP.inverse() @ RigidTransform(R_WC, X_WC[:3, 3]) @ X_BC.inverse()
        degrees = np.rad2deg(RollPitchYaw(X_PB.rotation()).vector())
        lines += [
            f"  {model.name}:  # {comment}",
            "    X_PB:",
            f"      base_frame: {config.X_PB.base_frame or 'world'}",
            f"      translation: {_numbers(X_PB.translation(), 6)}",
            f"      rotation: !Rpy {{ deg: {_numbers(degrees, 5)} }}",
        ]
    with whole_file(path) as file:
        file.write(("\n".join(lines) + "\n").encode())


def RequireCalibrationPath(path: Path) -> None:
    """Checks that a calibration would not overwrite a file of another kind, or its own picture.

    Raises:
        OutputError: if the file is no YAML file, or exists but was not written by
            `WriteCalibration`.
    """
    if path.suffix not in (".yaml", ".yml"):
        raise OutputError(
            f"The output '{path}' cannot be a scenario's calibration.",
            remedy="Use the suffix .yaml; a picture is written beside it.",
        )
    if path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            if not file.readline().startswith(_FIRST_LINE):
                raise OutputError(
                    f"The output '{path}' exists, and is not a calibration.",
                    remedy="Choose another output file.",
                )


def _numbers(values: np.ndarray, decimals: int) -> str:
    return f"[{', '.join(f'{value:.{decimals}f}' for value in values)}]"
