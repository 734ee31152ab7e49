"""The rigid transform that best maps one point set onto another, and the outliers of such a fit."""

from collections.abc import Callable
from functools import lru_cache
from itertools import combinations

import numpy as np

from poil_drake.geometry.rigid_transform import cross, make_transform, skew

_EXHAUSTIVE_COUNT = 10
"""With at most this many points, every set of three points is tried: at most 120 sets."""

_TRIALS = 200
"""Number of sets that are drawn at random if there are more points than `_EXHAUSTIVE_COUNT`. If
40 % of the points are outliers, every set contains an outlier with a probability below 1e-20."""

_MIN_ASPECT = 0.1
"""Least height of the triangle of a set's points, as a fraction of the longest side. With a thinner
triangle, noise would dominate the proposed rotation."""


def _rotation_terms() -> np.ndarray:
    """Returns the matrix (16, 9) that maps the products q_a q_b of a quaternion q to its rotation.

    With q = (w, u), the rotation is R = (w^2 - |u|^2) I + 2 u u^T + 2 w [u].
    """
    identity = np.eye(3)
    terms = np.zeros((4, 4, 3, 3))
    terms[0, 0] = identity
    terms[0, 1:] = terms[1:, 0] = skew(identity)
    dyads = np.einsum("ai,bj->abij", identity, identity)
    terms[1:, 1:] = dyads + dyads.swapaxes(0, 1) - np.einsum("ab,ij->abij", identity, identity)
    return terms.reshape(16, 9)


_ROTATION_TERMS = _rotation_terms()


def kabsch(source: np.ndarray, target: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Returns the rigid X (..., 4, 4) with the least sum_i w_i |target_i - X source_i|^2.

    This is the problem of Kabsch (1976). If the points do not determine the rotation, because there
    are fewer than 3 or because they are collinear, one of the best rotations is returned.

    Args:
        source: (..., N, 3) points [m].
        target: (..., N, 3) their targets [m].
        weights: (..., N) non-negative, not all zero; None for equal weights. A point of weight zero
            may be NaN.
    """
    source = np.asarray(source, dtype=float)
    target = np.asarray(target, dtype=float)
    w = np.ones(source.shape[-2]) if weights is None else np.asarray(weights, dtype=float)
    if weights is not None:
        # Points that were not observed are NaN, and NaN times zero is NaN.
        source = np.where(w[..., None] > 0.0, source, 0.0)
        target = np.where(w[..., None] > 0.0, target, 0.0)
    row = (w / np.sum(w, axis=-1, keepdims=True))[..., None, :]
    source_centroid, target_centroid = row @ source, row @ target
    R = _best_rotation((target - target_centroid).mT * row @ (source - source_centroid))
    return make_transform(R, (target_centroid - source_centroid @ R.mT)[..., 0, :])


def squared_motion_errors(source: np.ndarray, target: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Returns the squared residuals (..., N) [m^2] that the rigid motion of `kabsch` leaves.

    Args:
        source: (..., N, 3) finite points [m].
        target: (..., N, 3) their finite targets [m].
        shares: (..., N) weights that add up to 1.
    """
    row = shares[..., None, :]
    x, y = source - row @ source, target - row @ target
    errors = x @ _best_rotation(y.mT * row @ x).mT - y
    return np.vecdot(errors, errors)


def _best_rotation(covariance: np.ndarray) -> np.ndarray:
    """Returns the rotations R with the largest tr(R^T B), for B (..., 3, 3).

    Horn's method (1987): R is quadratic in a unit quaternion q, so tr(R^T B) = q^T K q, which is
    largest for the eigenvector of the largest eigenvalue of K. Unlike the SVD of Kabsch (1976), it
    gives no reflections.
    """
    leading = covariance.shape[:-2]
    K = covariance.reshape((*leading, 9)) @ _ROTATION_TERMS.T
    q = np.linalg.eigh(K.reshape((*leading, 4, 4)))[1][..., -1]
    products = (q[..., :, None] * q[..., None, :]).reshape((*leading, 16))
    return (products @ _ROTATION_TERMS).reshape((*leading, 3, 3))


def rigid_inliers(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray, inlier_distance: float
) -> np.ndarray:
    """Returns which points (N,) bool move from source to target by one rigid motion.

    If the best rigid motion of all points leaves every residual within the inlier distance, or if
    there are fewer than 4 points, all points are inliers. Otherwise `consensus` decides.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) their positions after the motion [m].
        weights: (N,) positive weights of the points.
        inlier_distance: Largest distance between an inlier's target and its moved source [m].
    """
    limit = inlier_distance**2
    squares = squared_motion_errors(source, target, weights / weights.sum())
    if len(source) < 4 or squares.max() <= limit:
        return np.ones(len(source), dtype=bool)
    return rigid_consensus(source, target, weights, inlier_distance)


def rigid_consensus(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray, inlier_distance: float
) -> np.ndarray:
    """Returns which points (N,) bool move by one rigid motion, found by `consensus`.

    The arguments are those of `rigid_inliers`.
    """
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
    """Returns which points (N,) bool are explained by one motion, found by RANSAC.

    Each set of three points proposes a motion. The motion with the least truncated cost (MSAC,
    Torr and Zisserman 2000) determines the inliers. A second motion is then fitted to them. If it
    has more inliers, they are returned instead. If there are no sets, all points are inliers.

    Args:
        triples: (K, 3) indices of the points in each set.
        squares: (N, K) squared residuals of the points under the motion that each set proposes.
        weights: (N,) positive weights of the points.
        limit: Largest squared residual of an inlier.
        refit: Fits a motion to points that are weighted by shares (N,), which add up to 1. It
            returns the squared residuals (N,) of that motion.
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
    """Returns the indices (K, 3) of sets of three points that span a wide enough triangle.

    Args:
        points: (N, 3) [m].
    """
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

    A motion maps a triangle's centroid and axes from the source to the target. The residual of a
    point is therefore the difference between its coordinates in the triangle's two frames.

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
    """Returns vectors (2, 3, K), scaled to unit length along axis 1; null vectors stay null."""
    squares = (vectors * vectors).sum(axis=1, keepdims=True)
    return vectors / np.sqrt(np.maximum(squares, 1e-24))
