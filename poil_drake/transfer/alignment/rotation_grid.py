"""Rotations that cover all orientations evenly."""

import numpy as np

_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041  # the positive root of x^4 = x + 4


def super_fibonacci_rotations(count: int) -> np.ndarray:
    """Returns rotation matrices (count, 3, 3) spread evenly over SO(3).

    The super-Fibonacci spiral of Alexa (CVPR 2022) has no holes, unlike random samples. With 720
    rotations, every orientation is within about 25 degrees of one of them.
    """
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
    """Returns the indices of the cheapest rotations that differ pairwise by more than an angle.

    Args:
        rotations: (K, 3, 3) rotation matrices.
        costs: (K,) their costs.
        angle: Smallest angle between two of the returned rotations [rad].
        count: Largest number of indices.

    Returns:
        (M,) indices in order of increasing cost, 1 <= M <= count.
    """
    kept: list[int] = []
    for index in np.argsort(costs, kind="stable"):
        traces = np.einsum("kij,ij->k", rotations[kept], rotations[index])
        if np.all(traces < 1.0 + 2.0 * np.cos(angle)):
            kept.append(int(index))
        if len(kept) == count:
            break
    return np.array(kept)
