"""Conversion of any camera's depth to metres."""

import numpy as np

from poil_drake.errors import NoImageError

_TOO_FAR = 65535
"""16-bit depth beyond the range, in Drake's images and those of saturated cameras."""


def depth_in_metres(raw: np.ndarray, *, step: float) -> np.ndarray:
    """Returns depth [m] as float32, 0 where invalid.

    Invalid floats are those that are not finite or not positive; invalid integers are 0 and 65535
    ("too far").

    Args:
        raw: Depth of any shape, float32 [m] or uint16 [steps].
        step: One step of integer depth [m].

    Raises:
        NoImageError: if it has another type.
    """
    if raw.dtype == np.uint16:
        metres = np.multiply(raw, np.float32(step), dtype=np.float32)
        metres[raw == _TOO_FAR] = 0.0
        return metres
    if raw.dtype == np.float32:
        return np.where(np.isfinite(raw) & (raw > 0.0), raw, np.float32(0.0))
    raise NoImageError(
        f"Depth has the type {raw.dtype}.",
        remedy="Deliver 32-bit floats in metres, or 16-bit integers.",
    )
