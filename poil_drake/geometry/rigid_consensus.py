"""Which points moved as one rigid body, and which did not."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.geometry.triples import TripleConfig, choose_triples, cross, triangle_corners


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
    Otherwise RANSAC: each set of three points proposes a motion; the one with the least truncated
    cost (MSAC, Torr and Zisserman 2000) names the inliers, and their best motion may win others.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) where they went [m].
        weights: (N,) positive; None for all equal.
        config: Distance and sets to try.
        seed: Of drawn sets. The result depends on nothing else.
    """
    w = np.ones(len(source)) if weights is None else weights
    everyone = np.ones(len(source), dtype=bool)
    limit = config.inlier_distance**2
    if len(source) < 4 or _best_motion_squares(source, target, w).max() <= limit:
        return everyone
    triples = choose_triples(source, config.triples, seed)
    if len(triples) == 0:
        return everyone
    squares = _triangle_motion_squares(source, target, triples)
    best = int((w @ np.minimum(squares, limit)).argmin())
    inliers = squares[:, best] <= limit
    inliers[triples[best]] = True
    grown = _best_motion_squares(source, target, w * inliers) <= limit
    return grown if np.count_nonzero(grown) > np.count_nonzero(inliers) else inliers


def _best_motion_squares(source: np.ndarray, target: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Returns the squared distances (N,) [m^2] that the best rigid motion leaves.

    `kabsch` without its checks and without making a transform, as it runs at every control tick.

    Args:
        source: (N, 3) points [m].
        target: (N, 3) where they went [m].
        weights: (N,) of the points in the choice of the motion, not negative, not all zero.
    """
    shares = weights / weights.sum()
    arms, target_arms = source - shares @ source, target - shares @ target
    U, _, Vt = np.linalg.svd((target_arms.T * shares) @ arms)
    R = U @ Vt
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    if a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0:  # A reflection.
        U[:, 2] *= -1.0
        R = U @ Vt
    errors = target_arms - arms @ R.T
    return np.einsum("ni,ni->n", errors, errors)


def _triangle_motion_squares(
    source: np.ndarray, target: np.ndarray, triples: np.ndarray
) -> np.ndarray:
    """Returns how far K motions leave the points from their targets, (N, K) squared [m^2].

    The k-th motion takes a triangle's centroid and frame from source to target. So a point and its
    target are as far apart after it as their coordinates in the two frames are. It is as good a
    proposal as Kabsch's, and several times as fast as that many decompositions.
    """
    corners = [triangle_corners(points, triples) for points in (source, target)]
    both = np.concatenate(corners, axis=2)
    frames = _triangle_frames(both)
    origins = np.einsum("ik,ijk->jk", both.sum(axis=1) / 3.0, frames)
    K = len(triples)
    # One matrix product for all triangles of a side.
    coordinates = source @ frames[..., :K].reshape(3, -1) - target @ frames[..., K:].reshape(3, -1)
    errors = coordinates.reshape(len(source), 3, K) - (origins[:, :K] - origins[:, K:])
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
