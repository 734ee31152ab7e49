"""Sampling of points that cover a cloud evenly."""

import numpy as np

from poil_drake.errors import InvalidValueError


def farthest_point_sampling(points: np.ndarray, count: int) -> np.ndarray:
    """Returns the indices (count,) of points that cover a cloud evenly.

    The first is the point farthest from the centroid; each later one is the point farthest from all
    those chosen before it. Ties go to the lowest index, so the result depends only on the points.

    Args:
        points: (P, 3) [m], finite.
        count: Number of points to choose, 1 to P.

    Raises:
        InvalidValueError: if `count` is less than 1 or more than P.
    """
    if not 1 <= count <= len(points):
        raise InvalidValueError(
            f"farthest_point_sampling() cannot choose {count} of {len(points)} points.",
            remedy="Pass a count from 1 to the number of points.",
        )
    indices = np.empty(count, dtype=np.intp)
    offsets = points - points.mean(axis=0)
    indices[0] = np.argmax(np.sum(offsets**2, axis=1))
    nearest = np.full(len(points), np.inf)
    for k in range(1, count):
        latest = points[indices[k - 1]]
        np.minimum(nearest, np.sum((points - latest) ** 2, axis=1), out=nearest)
        indices[k] = np.argmax(nearest)
    return indices
