"""Which points moved as one rigid body, and which did not."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from poil_drake.geometry.best_rotation import best_rotation
from poil_drake.geometry.centred_sums import CentredSums, centred_sums
from poil_drake.geometry.triples import choose_triples, cross, triangle_corners

_MINUS_IDENTITY = (-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)


@dataclass(frozen=True, kw_only=True)
class RigidConsensusConfig:
    """When a point counts as an outlier.

    Attributes:
        inlier_distance: Largest distance of an inlier from where the rigid motion puts it [m].
            5 mm is about five standard deviations of a tracker's noise.
    """

    inlier_distance: float = 0.005


def rigid_inliers(
    source: np.ndarray,
    target: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    config: RigidConsensusConfig,
) -> np.ndarray:
    """Returns which points (N,) bool move from source to target by one rigid motion.

    If the best rigid motion of all points leaves every residual within the inlier distance, all
    points are inliers. Otherwise see `consensus_inliers`.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) their positions after the motion [m].
        weights: (N,) positive; None for equal weights.
        config: The inlier distance.
    """
    w = np.ones(len(source)) if weights is None else weights
    if len(source) > 3:
        sums = centred_sums((source, target), w)
        if motion_squares(sums).max() > config.inlier_distance**2:
            return consensus_inliers(source, target, w, config=config)
    return np.ones(len(source), dtype=bool)


def motion_squares(sums: CentredSums) -> np.ndarray:
    """Returns the squared residuals (N,) [m^2] of the best rigid motion.

    The motion is that of `kabsch`, without its checks, because it runs at every control tick.

    Args:
        sums: Sums of the points [m] and, last, of their positions after the motion [m].
    """
    # The sums of r y^T are those of y r^T transposed, and so is the rotation: r^T R^T less y^T.
    first, second, third = sums.sums
    R_transposed = best_rotation((first[-3:], second[-3:], third[-3:]))
    between = (0.0,) * (3 * len(sums.mean) - 18)
    return sums.combine(R_transposed + between + _MINUS_IDENTITY)


def consensus_inliers(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray, *, config: RigidConsensusConfig
) -> np.ndarray:
    """Returns the inliers (N,) bool where the best motion of all points leaves some too far off.

    Points are kept if their distances to points of more than half of the total weight are
    unchanged. If these are more than half of the weight themselves, and their best motion leaves
    none of them too far off, that motion determines the inliers. Otherwise see `ransac_inliers`.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) their positions after the motion [m].
        weights: (N,) positive.
        config: The inlier distance.
    """
    # Noise seldom changes the distance of two inliers by as much as one of them may be off. Where
    # it does, too few points are kept, or their motion does not confirm them.
    changed = np.abs(cdist(source, source) - cdist(target, target)) > config.inlier_distance
    half = 0.5 * weights.sum()
    kept = changed.dot(weights) < half
    if np.count_nonzero(kept) >= 3 and weights.dot(kept) > half:
        squares = motion_squares(centred_sums((source, target), weights * kept))
        inliers = squares <= config.inlier_distance**2
        if inliers[kept].all():
            return inliers
    return ransac_inliers(source, target, weights, config=config)


def ransac_inliers(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray, *, config: RigidConsensusConfig
) -> np.ndarray:
    """Returns which points (N,) bool one rigid motion explains, by RANSAC.

    Each set of three points proposes a motion. The motion with the least truncated cost (MSAC,
    Torr and Zisserman 2000) determines the inliers, and their best motion may add others. Where
    all points are collinear, all are inliers.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) their positions after the motion [m].
        weights: (N,) positive.
        config: The inlier distance.
    """
    limit = config.inlier_distance**2
    triples = choose_triples(source)
    if len(triples) == 0:
        return np.ones(len(source), dtype=bool)
    squares = _triangle_motion_squares(source, target, triples)
    best = int(weights.dot(np.minimum(squares, limit)).argmin())
    inliers = squares[:, best] <= limit
    inliers[triples[best]] = True
    grown = motion_squares(centred_sums((source, target), weights * inliers)) <= limit
    return grown if np.count_nonzero(grown) > np.count_nonzero(inliers) else inliers


def _triangle_motion_squares(
    source: np.ndarray, target: np.ndarray, triples: np.ndarray
) -> np.ndarray:
    """Returns the squared residuals (N, K) [m^2] that the motions of K triangles leave.

    The k-th motion takes a triangle's centroid and frame from source to target, so a residual is
    the difference of a point's coordinates in the source frame and its target's in the target
    frame. The proposal is as good as Kabsch's and takes a fraction of the time.
    """
    N, K = len(source), len(triples)
    # The triangles of the source, then those of the target.
    corners = triangle_corners(
        np.concatenate((source, target)), np.concatenate((triples, triples + N))
    )
    frames = _triangle_frames(corners)
    origins = np.einsum("ik,ijk->jk", corners.sum(axis=1) / 3.0, frames)
    # One matrix product for all triangles of the source, another for those of the target.
    errors = source.dot(frames[..., :K].reshape(3, -1))
    errors -= target.dot(frames[..., K:].reshape(3, -1))
    errors -= (origins[:, :K] - origins[:, K:]).ravel()
    errors = errors.reshape(N, 3, K)
    return np.einsum("njk,njk->nk", errors, errors)


def _triangle_frames(corners: np.ndarray) -> np.ndarray:
    """Returns the axes of frames (3, 3, K), coordinate first, of corners (3, 3, K).

    They point along the first side, in the triangle's plane, and along its normal.
    """
    first = corners[:, 1] - corners[:, 0]
    normal = cross(first, corners[:, 2] - corners[:, 0])
    frames = np.stack([first, cross(normal, first), normal], axis=1)
    # Target triangles may be degenerate; these propose nothing useful.
    return frames / np.maximum(np.sqrt(np.einsum("ijk,ijk->jk", frames, frames)), 1e-12)
