"""Whether a camera's own intrinsics are those that the scenario says."""

import numpy as np

from poil_drake.errors import CaptureError
from poil_drake.perception.images import CameraModel

_TOLERANCE = 1.0
"""How far fx, fy, cx and cy may be off [px]. At 1 m, 1 px is 1 to 2 mm."""


def check_intrinsics(K: np.ndarray, camera: CameraModel, *, source: str) -> None:
    """Checks that a camera has the intrinsics of its model.

    Args:
        K: (3, 3) what the camera has, for images of the model's size [px]; pixel centres are at
            integer coordinates.
        camera: The scenario's model.
        source: What to call the camera in an error.

    Raises:
        CaptureError: naming both, with what to write into the scenario, if they differ by more than
            a pixel.
    """
    found, said = (_parameters(matrix) for matrix in (K, camera.K))
    if max(abs(a - b) for a, b in zip(found, said, strict=True)) <= _TOLERANCE:
        return
    fx, fy, cx, cy = found
    raise CaptureError(
        f"{source} has fx, fy, cx, cy = {_text(found)} px, but the scenario says {_text(said)} px.",
        remedy=f"Write into the scenario: cameras: {{ {camera.name}: {{ focal: !FocalLength "
        f"{{ x: {fx:.2f}, y: {fy:.2f} }}, center_x: {cx:.2f}, center_y: {cy:.2f} }} }}",
    )


def _parameters(K: np.ndarray) -> tuple[float, float, float, float]:
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def _text(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
