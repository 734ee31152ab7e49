"""Checks that a camera's own intrinsics agree with the scenario."""

import numpy as np

from poil_drake.errors import CaptureError
from poil_drake.perception.images import CameraModel

_TOLERANCE = 1.0
"""Largest accepted difference in fx, fy, cx and cy [px]. At 1 m, 1 px is 1 to 2 mm."""


def check_intrinsics(K: np.ndarray, camera: CameraModel, *, source: str) -> None:
    """Checks that a camera has the intrinsics of its model.

    Args:
        K: (3, 3) the camera's own intrinsic matrix, for images of the model's size [px]; pixel
            centres are at integer coordinates.
        camera: The camera's model in the scenario.
        source: The camera's name in errors.

    Raises:
        CaptureError: if fx, fy, cx or cy differs by more than a pixel. The remedy is the YAML with
            the camera's own values.
    """
    found, expected = (M[[0, 1, 0, 1], [0, 1, 2, 2]] for M in (K, camera.K))
    if np.abs(found - expected).max() <= _TOLERANCE:
        return
    fx, fy, cx, cy = found
    raise CaptureError(
        f"{source} has fx, fy, cx, cy = {_text(found)} px, but the scenario has "
        f"{_text(expected)} px.",
        remedy=f"Set in the scenario: cameras: {{ {camera.name}: {{ focal: !FocalLength "
        f"{{ x: {fx:.2f}, y: {fy:.2f} }}, center_x: {cx:.2f}, center_y: {cy:.2f} }} }}",
    )


def _text(values: np.ndarray) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
