"""Which points moved as one rigid body, and which did not."""

from collections.abc import Callable
from functools import lru_cache
from itertools import combinations

import numpy as np

from poil_drake.geometry.rigid_fit import squared_motion_errors
from poil_drake.geometry.rigid_transform import cross

_EXHAUSTIVE_COUNT = 10
"""Up to this many points all sets of three are tried, 120 at most, so that nothing is left to
chance."""

_TRIALS = 200
"""Random sets with more points. With 40 % outliers the probability that all of them contain an
outlier is below 1e-20."""

_MIN_ASPECT = 0.1
"""Sets whose triangle is thinner than this, height over longest side, propose nothing, because
noise dominates their rotation."""


def rigid_inliers(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray, inlier_distance: float
) -> np.ndarray:
    """Returns which points (N,) bool move from source to target by one rigid motion.

    If the best rigid motion of all points leaves every residual within the inlier distance, all
    points are inliers. Otherwise see `consensus`.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) their positions after the motion [m].
        weights: (N,) positive.
        inlier_distance: Largest distance of an inlier from where the motion puts it [m].
    """
    limit = inlier_distance**2
    squares = squared_motion_errors(source, target, weights / weights.sum())
    if len(source) < 4 or squares.max() <= limit:
        return np.ones(len(source), dtype=bool)
    return rigid_consensus(source, target, weights, inlier_distance)


def rigid_consensus(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray, inlier_distance: float
) -> np.ndarray:
    """Returns `consensus` on a rigid motion; the arguments are those of `rigid_inliers`."""
    triples = choose_triples(source)
    return consensus(
        triples,
        _triangle_motion_errors(np.stack([source, target]), triples),
        weights,
        inlier_distance**2,
        lambda shares: squared_motion_errors(source, target, shares),
    )


def consensus(
    triples: np.ndarray,
    squares: np.ndarray,
    weights: np.ndarray,
    limit: float,
    refit: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Returns the points (N,) bool that one motion explains, by RANSAC.

    Each set of three points proposes a motion. The motion with the least truncated cost (MSAC,
    Torr and Zisserman 2000) determines the inliers, and their best motion may add others. Where
    nothing is proposed, all are inliers.

    Args:
        triples: (K, 3) the sets.
        squares: (N, K) squared residuals of the motions that they propose.
        weights: (N,) positive.
        limit: Largest squared residual of an inlier.
        refit: Returns the squared residuals (N,) of the best motion, given shares (N,) of the
            points that add up to 1.
    """
    if len(triples) == 0:
        return np.ones(len(weights), dtype=bool)
    best = (weights @ np.minimum(squares, limit)).argmin()
    inliers = squares[:, best] <= limit
    inliers[triples[best]] = True
    kept = weights * inliers
    grown = refit(kept / kept.sum()) <= limit
    return grown if np.count_nonzero(grown) > np.count_nonzero(inliers) else inliers


def choose_triples(points: np.ndarray) -> np.ndarray:
    """Returns the indices (K, 3) of the sets of points (N, 3) that span a wide enough triangle."""
    triples = _triples(len(points))
    corners = points.T.take(triples.T, axis=1)
    sides = corners.take([1, 2, 0], axis=1) - corners
    squares = (sides * sides).sum(axis=0)
    # By Lagrange's identity this is |a x b|^2, the square of height times longest side.
    area = squares[0] * squares[1] - (sides[:, 0] * sides[:, 1]).sum(axis=0) ** 2
    return triples[area > (_MIN_ASPECT * squares.max(axis=0)) ** 2]


@lru_cache(maxsize=32)
def _triples(count: int) -> np.ndarray:
    if count <= _EXHAUSTIVE_COUNT:
        return np.array(list(combinations(range(count), 3)), dtype=np.intp).reshape(-1, 3)
    rng = np.random.default_rng([0, count])
    return np.array([rng.choice(count, 3, replace=False) for _ in range(_TRIALS)])


def _triangle_motion_errors(points: np.ndarray, triples: np.ndarray) -> np.ndarray:
    """Returns the squared residuals (N, K) [m^2] of the motions that K triangles propose.

    A motion takes a triangle's centroid and frame from source to target, so a residual is the
    difference of a point's coordinates in the two frames.

    Args:
        points: (2, N, 3) source and target [m].
        triples: (K, 3) indices of the corners.
    """
    # The axes are source or target, coordinate, corner or axis of the frame, triangle.
    corners = points.mT.take(triples.T, axis=2)
    first, second = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    first = _unit(first)
    second = _unit(second - (first * second).sum(axis=1, keepdims=True) * first)
    axes = np.stack([first, second, cross(first, second, axis=1)], axis=2)
    origins = (corners.mean(axis=2)[:, :, None] * axes).sum(axis=1)
    coordinates = (points @ axes.reshape(2, 3, -1)).reshape(2, points.shape[1], 3, -1)
    errors = (coordinates[0] - coordinates[1]) - (origins[0] - origins[1])
    return (errors * errors).sum(axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Returns vectors (2, 3, K) of unit length; null vectors stay null."""
    squares = (vectors * vectors).sum(axis=1, keepdims=True)
    return vectors / np.sqrt(np.maximum(squares, 1e-24))
