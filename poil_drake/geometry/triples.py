"""Sets of three points: the smallest that a rigid motion can be fitted to."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

_NEXT = np.array([1, 2, 0])
_AFTER_NEXT = np.array([2, 0, 1])


@dataclass(frozen=True, kw_only=True)
class TripleConfig:
    """Which sets of three points RANSAC tries.

    Attributes:
        exhaustive_count: Up to this many points, every set is tried (120 for 10 points), which
            needs no chance at all.
        trials: Sets that are drawn when there are more points. 200 find one without outliers among
            40 % outliers with a failure rate below 1e-20.
        min_aspect: Sets whose triangle is thinner than this, height over longest side, are skipped,
            since their rotation is mostly noise.
    """

    exhaustive_count: int = 10
    trials: int = 200
    min_aspect: float = 0.1


def choose_triples(points: np.ndarray, config: TripleConfig, seed: int = 0) -> np.ndarray:
    """Returns the indices (K, 3) of the sets to try; none where all points lie on a line.

    Args:
        points: (N, 3) [m].
        config: Which sets.
        seed: Of the drawn sets. The result depends on nothing else.
    """
    triples = _triples(len(points), config.exhaustive_count, config.trials, seed)
    corners = triangle_corners(points, triples)
    sides = corners.take(_NEXT, axis=1) - corners
    longest = np.einsum("isk,isk->sk", sides, sides).max(axis=0)
    normals = cross(sides[:, 0], sides[:, 1])
    # Twice the area, which is the normal's length, is height times longest side.
    fat = np.einsum("ik,ik->k", normals, normals) > (config.min_aspect * longest) ** 2
    return triples[fat]


def triangle_corners(points: np.ndarray, triples: np.ndarray) -> np.ndarray:
    """Returns the corners (3, 3, K) [m] of triangles: x, y, z first, then the corner.

    With the triangles last, NumPy works on all of them at a time in every step.

    Args:
        points: (N, 3) [m].
        triples: (K, 3) indices.
    """
    return points.T.take(triples.T, axis=1)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns a x b (3, ...) of vectors (3, ...), some ten times as fast as `np.cross`."""
    return a.take(_NEXT, 0) * b.take(_AFTER_NEXT, 0) - a.take(_AFTER_NEXT, 0) * b.take(_NEXT, 0)


@lru_cache(maxsize=32)
def _triples(count: int, exhaustive_count: int, trials: int, seed: int) -> np.ndarray:
    if count <= exhaustive_count:
        return np.array(list(combinations(range(count), 3)), dtype=np.intp).reshape(-1, 3)
    rng = np.random.default_rng([seed, count])
    return np.array([rng.choice(count, 3, replace=False) for _ in range(trials)], dtype=np.intp)
