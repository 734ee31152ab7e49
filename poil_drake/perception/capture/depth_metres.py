"""Depth of any camera in metres."""

import numpy as np

from poil_drake.errors import NoImageError

_TOO_FAR = 65535
"""16-bit depth that is too large to be told, in Drake's images and those of saturated cameras."""


def depth_in_metres(raw: np.ndarray, *, step: float) -> np.ndarray:
    """Returns depth [m] as float32, 0 where invalid.

    Invalid are, of floats, those that are not finite or not above 0; of integers 0 and 65535, which
    means "too far".

    Args:
        raw: Depth of any shape, float32 [m] or uint16 [steps].
        step: What one step of integers is [m].

    Raises:
        NoImageError: if it is of another type; in other units it would look right and be wrong.
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
