"""Rotations that cover all orientations evenly."""

import numpy as np

from poil_drake.errors import InvalidValueError

_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041  # the positive root of x^4 = x + 4


def super_fibonacci_rotations(count: int) -> np.ndarray:
    """Returns rotation matrices (count, 3, 3) spread evenly over SO(3).

    The super-Fibonacci spiral of Alexa (CVPR 2022): deterministic, any count, without the holes of
    random sampling. With 720, no orientation is more than about 25 degrees from one of them.

    Args:
        count: How many, at least 1.

    Raises:
        InvalidValueError: if `count` is less than 1.
    """
    if count < 1:
        raise InvalidValueError(
            f"super_fibonacci_rotations() should return {count} rotations.",
            remedy="Ask for at least one.",
        )
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2.0 * np.pi * s / _PHI, 2.0 * np.pi * s / _PSI
    x, y = inner * np.sin(alpha), inner * np.cos(alpha)
    z, w = outer * np.sin(beta), outer * np.cos(beta)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def distinct_rotations(
    rotations: np.ndarray, costs: np.ndarray, *, angle: float, count: int
) -> np.ndarray:
    """Returns indices of the cheapest rotations that differ pairwise by more than an angle.

    Args:
        rotations: (K, 3, 3).
        costs: (K,), the lower the better.
        angle: Nearer rotations count as the same [rad].
        count: At most this many are returned.

    Returns:
        (M,) indices, cheapest first; 1 <= M <= count.
    """
    kept: list[int] = []
    for index in np.argsort(costs, kind="stable"):
        traces = np.einsum("kij,ij->k", rotations[kept], rotations[index])
        if np.all(traces < 1.0 + 2.0 * np.cos(angle)):
            kept.append(int(index))
        if len(kept) == count:
            break
    return np.array(kept)
