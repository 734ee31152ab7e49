"""Which points moved as one rigid body, and which did not."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.distance import cdist

from poil_drake.geometry.best_rotation import best_rotation
from poil_drake.geometry.centred_sums import CentredSums, centred_sums
from poil_drake.geometry.triples import TripleConfig, choose_triples, cross, triangle_corners

_MINUS_IDENTITY = (-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)


@dataclass(frozen=True, kw_only=True)
class RigidConsensusConfig:
    """When a point has left the body.

    Attributes:
        inlier_distance: Largest distance from where the rigid motion puts a point [m]. 5 mm is
            some five standard deviations of a tracker's noise.
        triples: Which sets of three points are tried.
    """

    inlier_distance: float = 0.005
    triples: TripleConfig = field(default_factory=TripleConfig)


def rigid_inliers(
    source: np.ndarray,
    target: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    config: RigidConsensusConfig,
    seed: int = 0,
) -> np.ndarray:
    """Returns which points (N,) bool go from source to target by one rigid motion.

    Where the best rigid motion of all points leaves none too far off, that is all of them.
    Otherwise points of more than half of the weight may have kept their distances from such a part
    of all points. If the best motion of these leaves none of them too far off, it names the
    inliers. All other cases are for `ransac_inliers`.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) where they went [m].
        weights: (N,) positive; None for all equal.
        config: Distance and sets to try.
        seed: Of drawn sets. The result depends on nothing else.
    """
    w = np.ones(len(source)) if weights is None else weights
    if len(source) > 3:
        sums = centred_sums((source, target), w)
        if motion_squares(sums).max() > config.inlier_distance**2:
            return consensus_inliers(source, target, w, config=config, seed=seed)
    return np.ones(len(source), dtype=bool)


def motion_squares(sums: CentredSums) -> np.ndarray:
    """Returns the squared distances (N,) [m^2] that the best rigid motion leaves.

    It is what `kabsch` finds, without its checks, as it runs at every control tick.

    Args:
        sums: Of the points [m] and, last, of where they went [m].
    """
    # The sums of r y^T are those of y r^T transposed, and so is the rotation: r^T R^T less y^T.
    first, second, third = sums.sums
    R_transposed = best_rotation((first[-3:], second[-3:], third[-3:]))
    between = (0.0,) * (3 * len(sums.mean) - 18)
    return sums.combine(R_transposed + between + _MINUS_IDENTITY)


def consensus_inliers(
    source: np.ndarray,
    target: np.ndarray,
    weights: np.ndarray,
    *,
    config: RigidConsensusConfig,
    seed: int = 0,
) -> np.ndarray:
    """Returns what `rigid_inliers` does where the best motion of all points leaves some too far."""
    agreed = _agreed_by_pairs(source, target, weights, config.inlier_distance)
    if agreed is None:
        return ransac_inliers(source, target, weights, config=config, seed=seed)
    return agreed


def _agreed_by_pairs(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray, distance: float
) -> np.ndarray | None:
    """Returns the inliers if pairs of points can tell them, None otherwise.

    With noise the distance of two inliers seldom changes by as much as one of them may be off;
    where it does, too few agree, or their motion does not confirm it.
    """
    changed = np.abs(cdist(source, source) - cdist(target, target)) > distance
    half = 0.5 * weights.sum()
    agreed = changed.dot(weights) < half
    if np.count_nonzero(agreed) < 3 or weights.dot(agreed) <= half:
        return None
    within = motion_squares(centred_sums((source, target), weights * agreed)) <= distance**2
    return within if within[agreed].all() else None


def ransac_inliers(
    source: np.ndarray,
    target: np.ndarray,
    weights: np.ndarray,
    *,
    config: RigidConsensusConfig,
    seed: int = 0,
) -> np.ndarray:
    """Returns which points (N,) bool one rigid motion explains, by RANSAC.

    Each set of three points proposes a motion; the one with the least truncated cost (MSAC, Torr
    and Zisserman 2000) names the inliers, and their best motion may win others. Where all points
    are on a line, none is an outlier.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) where they went [m].
        weights: (N,) positive.
        config: Distance and sets to try.
        seed: Of drawn sets. The result depends on nothing else.
    """
    limit = config.inlier_distance**2
    triples = choose_triples(source, config.triples, seed)
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
    """Returns how far K motions leave the points from their targets, (N, K) squared [m^2].

    The k-th motion takes a triangle's centroid and frame from source to target. So a point and its
    target are as far apart after it as their coordinates in the two frames are. It is as good a
    proposal as Kabsch's, and several times as fast as that many decompositions.
    """
    N, K = len(source), len(triples)
    # The triangles of both sides, one after the other.
    corners = triangle_corners(
        np.concatenate((source, target)), np.concatenate((triples, triples + N))
    )
    frames = _triangle_frames(corners)
    origins = np.einsum("ik,ijk->jk", corners.sum(axis=1) / 3.0, frames)
    # One matrix product for all triangles of a side.
    errors = source.dot(frames[..., :K].reshape(3, -1))
    errors -= target.dot(frames[..., K:].reshape(3, -1))
    errors -= (origins[:, :K] - origins[:, K:]).ravel()
    errors = errors.reshape(N, 3, K)
    return np.einsum("njk,njk->nk", errors, errors)


def _triangle_frames(corners: np.ndarray) -> np.ndarray:
    """Returns the axes of frames, (3, 3, K) with x, y, z first, of corners (3, 3, K).

    They point along the first side, in the plane, and along the normal.
    """
    first = corners[:, 1] - corners[:, 0]
    normal = cross(first, corners[:, 2] - corners[:, 0])
    frames = np.stack([first, cross(normal, first), normal], axis=1)
    # Target triangles may be degenerate, and propose nothing sensible then.
    return frames / np.maximum(np.sqrt(np.einsum("ijk,ijk->jk", frames, frames)), 1e-12)
