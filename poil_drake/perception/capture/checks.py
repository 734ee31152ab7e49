"""Checks the images and the intrinsics of a camera."""

import numpy as np

from poil_drake.errors import CaptureError, NoImageError
from poil_drake.geometry.depth_image import depth_in_metres
from poil_drake.perception.images import CameraModel, RgbdImage

_INTRINSICS_TOLERANCE = 1.0
"""Largest accepted difference in fx, fy, cx and cy [px]. At 1 m, 1 px is 1 to 2 mm."""


def checked_image(
    rgb: np.ndarray,
    depth: np.ndarray,
    *,
    stamp: float,
    size: tuple[int, int],
    source: str,
    depth_step: float | None = None,
) -> RgbdImage:
    """Returns the image that a camera delivered, with depth converted by `depth_in_metres`.

    Args:
        rgb: (H, W, 3) uint8 colour. An array that owns its data becomes read-only instead of being
            copied.
        depth: (H, W) float32 [m], e.g. with NaN where nothing was measured, or uint16 [steps].
        stamp: Time of capture [s].
        size: The expected (H, W) [px].
        source: The camera's name in errors.
        depth_step: One step of uint16 depth [m]; None if depth is float32.

    Raises:
        NoImageError: if an array has the wrong type or size. Arrays are not cast, because depth in
            other units, for example, would look right but be wrong.
    """
    for name, pixels, shape, dtype in (
        ("colour", rgb, (*size, 3), np.uint8),
        ("depth", depth, size, np.float32 if depth_step is None else np.uint16),
    ):
        if pixels.dtype != dtype or pixels.shape != shape:
            raise NoImageError(
                f"{source} delivers {name} of shape {pixels.shape} and type {pixels.dtype}, but "
                f"shape {shape} and type {np.dtype(dtype)} are needed.",
                remedy="Use a source of the needed type, and set the camera's size in the scenario "
                "to the delivered size, with the calibration for it.",
            )
    metres = depth_in_metres(depth, step=depth_step or 0.0)
    for pixels in (rgb, metres):
        if pixels.flags.owndata:
            pixels.flags.writeable = False
    return RgbdImage(rgb, metres, stamp)


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
    if np.abs(found - expected).max() <= _INTRINSICS_TOLERANCE:
        return
    fx, fy, cx, cy = found
    raise CaptureError(
        f"{source} has fx, fy, cx, cy = {_text(found)} px, but the scenario has "
        f"{_text(expected)} px.",
        remedy=f"Set in the scenario: cameras: {{ {camera.name}: {{ focal: !FocalLength "
        f"{{ x: {fx:.2f}, y: {fy:.2f} }}, center_x: {cx:.2f}, center_y: {cy:.2f} }} }}",
    )


def check_same_view(found: CameraModel, camera: CameraModel, *, source: str) -> None:
    """Checks that a recorded camera has the image size and the intrinsics of its model.

    Args:
        found: The recorded camera.
        camera: The camera's model in the scenario.
        source: The recorded camera's name in errors.

    Raises:
        CaptureError: if it does not.
    """
    if (found.width, found.height) != (camera.width, camera.height):
        raise CaptureError(
            f"{source} has images of {found.width} x {found.height} pixels, but the camera in the "
            f"scenario has {camera.width} x {camera.height}.",
            remedy="Set the camera's size and calibration to those of the recording.",
        )
    check_intrinsics(found.K, camera, source=source)


def _text(values: np.ndarray) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
