"""Choosing a few points that spread over a cloud."""

import numpy as np

from poil_drake.errors import InvalidValueError


def farthest_point_sampling(points: np.ndarray, count: int) -> np.ndarray:
    """Returns the indices (count,) of points that cover a cloud evenly.

    The first is the point farthest from the centroid; each next one is the point farthest from all
    chosen so far. Ties go to the lowest index, so the result depends on nothing but the points.

    Args:
        points: (P, 3) [m].
        count: How many to choose, 1 to P.

    Raises:
        InvalidValueError: if there are fewer points than wanted, or one is not finite.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or not 1 <= count <= len(points):
        raise InvalidValueError(
            f"farthest_point_sampling() should choose {count} of points of shape {points.shape}.",
            remedy="Pass a cloud (P, 3) of at least that many points.",
        )
    if not np.all(np.isfinite(points)):
        raise InvalidValueError(
            "farthest_point_sampling() got points that are not finite.",
            remedy="Leave out invalid points first.",
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
