"""A short history of a rigid motion, sampled on a regular time grid."""

import math

import numpy as np

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, rotation_log

ROW_SIZE = 17
"""Size of a row of a history: the time of the sample [s], then X (4, 4) row-major."""

_ON_GRID = 1e-6
"""A time within this fraction of a period from a sample counts as the sample's time."""


def empty_history(duration: float, period: float) -> np.ndarray:
    """Returns an empty history (M, 17) for `duration` [s], with a row for every `period` [s]."""
    return np.full((math.ceil(duration / period) + 2, ROW_SIZE), np.nan)


def record_motion(history: np.ndarray, time: float, X: np.ndarray, period: float) -> None:
    """Replaces the oldest row by X (4, 4) at `time` [s], a multiple of `period` [s]; in place."""
    row = history[round(time / period) % len(history)]
    row[0] = time
    row[1:] = X.ravel()


def motion_at(history: np.ndarray, time: float, period: float) -> np.ndarray | None:
    """Returns X (4, 4) at `time` [s], or None if the history does not cover that time.

    Between two samples the translation is interpolated linearly, the rotation along the geodesic.
    """
    before = math.floor(time / period + _ON_GRID)
    fraction = time / period - before
    first = _sample(history, before, period)
    if first is None or abs(fraction) <= _ON_GRID:
        return first
    second = _sample(history, before + 1, period)
    if second is None:
        return None
    turn = rotation_log(first[:3, :3].T @ second[:3, :3])
    return make_transform(
        first[:3, :3] @ rotation_exp(fraction * turn),
        (1.0 - fraction) * first[:3, 3] + fraction * second[:3, 3],
    )


def _sample(history: np.ndarray, tick: int, period: float) -> np.ndarray | None:
    row = history[tick % len(history)]
    held = abs(row[0] - tick * period) < 0.5 * period  # False for NaN
    return row[1:].reshape(4, 4).copy() if held else None
