"""Writes calibrated camera poses as a file for the scenario key `poil.calibration`."""

import time
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

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
        comment, X_WC = "as before", model.X_WC
        if found is not None and found.position_error > 0.0:
            X_WC = found.X_WC
            comment = (
                f"standard error {1e3 * found.position_error:.2f} mm and "
                f"{np.rad2deg(found.rotation_error):.3f} deg; reprojection {found.rms:.2f} px (RMS)"
            )
        # Nothing but the camera's body moves: X_WC = X_WP X_PB X_BC.
        X_BC = config.X_BC.GetDeterministicValue()
        X_PB_before = config.X_PB.GetDeterministicValue()
        X_WP = RigidTransform(model.X_WC) @ X_BC.inverse() @ X_PB_before.inverse()
        X_PB = X_WP.inverse() @ RigidTransform(_orthonormal(X_WC)) @ X_BC.inverse()
        degrees = np.rad2deg(RollPitchYaw(X_PB.rotation()).vector())
        base = config.X_PB.base_frame
        lines += [
            f"  {model.name}:  # {comment}",
            "    X_PB:",
            *([f"      base_frame: {base}"] if base else []),
            f"      translation: {_numbers(X_PB.translation(), 6)}",
            f"      rotation: !Rpy {{ deg: {_numbers(degrees, 5)} }}",
        ]
    with whole_file(path) as file:
        file.write(("\n".join(lines) + "\n").encode())


def RequireCalibrationPath(path: Path) -> None:
    """Checks that a calibration would not overwrite a file of another kind.

    Raises:
        OutputError: if the file exists and was not written by `WriteCalibration`.
    """
    if path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            if not file.readline().startswith(_FIRST_LINE):
                raise OutputError(
                    f"The output '{path}' exists, and is not a calibration.",
                    remedy="Choose another output file.",
                )


def _orthonormal(X: np.ndarray) -> np.ndarray:
    """Returns X (4, 4) without the rounding errors that Drake refuses."""
    U, _, Vt = np.linalg.svd(X[:3, :3])
    exact = X.copy()
    exact[:3, :3] = U @ Vt
    return exact


def _numbers(values: np.ndarray, decimals: int) -> str:
    return f"[{', '.join(f'{value:.{decimals}f}' for value in values)}]"
