"""Sets of three points: the smallest that determine a rigid motion."""

from functools import lru_cache
from itertools import combinations

import numpy as np

_EXHAUSTIVE_COUNT = 10
"""Up to this many points all sets are tried, 120 at most, so that nothing is left to chance."""

_TRIALS = 200
"""Random sets with more points. With 40 % outliers the probability that all of them contain an
outlier is below 1e-20."""

_MIN_ASPECT = 0.1
"""Sets whose triangle is thinner than this, height over longest side, are skipped, because noise
dominates their rotation."""

_NEXT = np.array([1, 2, 0])
_AFTER_NEXT = np.array([2, 0, 1])


def choose_triples(points: np.ndarray) -> np.ndarray:
    """Returns the indices (K, 3) of the sets for RANSAC to try; K = 0 if all points are collinear.

    Args:
        points: (N, 3) [m].
    """
    triples = _triples(len(points))
    corners = triangle_corners(points, triples)
    sides = corners.take(_NEXT, axis=1) - corners
    longest = np.einsum("isk,isk->sk", sides, sides).max(axis=0)
    normals = cross(sides[:, 0], sides[:, 1])
    # The normal's length is twice the area, which is height times longest side.
    fat = np.einsum("ik,ik->k", normals, normals) > (_MIN_ASPECT * longest) ** 2
    return triples[fat]


def triangle_corners(points: np.ndarray, triples: np.ndarray) -> np.ndarray:
    """Returns the corners of triangles (3, 3, K) [m]; the axes are coordinate, corner, triangle.

    With the triangles last, each NumPy operation runs over all of them.

    Args:
        points: (N, 3) [m].
        triples: (K, 3) indices.
    """
    return points.T.take(triples.T, axis=1)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns a x b (3, ...) of vectors (3, ...), about ten times as fast as `np.cross`."""
    return a.take(_NEXT, 0) * b.take(_AFTER_NEXT, 0) - a.take(_AFTER_NEXT, 0) * b.take(_NEXT, 0)


@lru_cache(maxsize=32)
def _triples(count: int) -> np.ndarray:
    if count <= _EXHAUSTIVE_COUNT:
        return np.array(list(combinations(range(count), 3)), dtype=np.intp).reshape(-1, 3)
    rng = np.random.default_rng([0, count])
    return np.array([rng.choice(count, 3, replace=False) for _ in range(_TRIALS)], dtype=np.intp)
