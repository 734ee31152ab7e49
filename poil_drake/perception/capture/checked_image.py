"""Checks the images that a camera delivers, and converts their depth to metres."""

import numpy as np

from poil_drake.errors import NoImageError
from poil_drake.perception.images import RgbdImage

_TOO_FAR = 65535
"""The 16-bit depth that means "too far" in the images of Drake and of saturated cameras."""


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


def depth_in_metres(raw: np.ndarray, *, step: float) -> np.ndarray:
    """Returns depth [m] as float32, 0 where invalid.

    A float is invalid if it is not finite or not positive. An integer is invalid if it is 0 or
    65535 ("too far").

    Args:
        raw: Depth of any shape, float32 [m] or uint16 [steps].
        step: One step of integer depth [m].

    Raises:
        NoImageError: if `raw` has another type.
    """
    if raw.dtype == np.uint16:
        metres = np.multiply(raw, np.float32(step), dtype=np.float32)
        metres[raw == _TOO_FAR] = 0.0
        return metres
    if raw.dtype == np.float32:
        return np.where(np.isfinite(raw) & (raw > 0.0), raw, np.float32(0.0))
    raise NoImageError(
        f"Depth has the unsupported type {raw.dtype}.",
        remedy="Use 32-bit floats in metres, or unsigned 16-bit integers.",
    )
