"""Which points moved as one rigid body, and which did not."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import make_transform, transform_points
from poil_drake.geometry.triples import TripleConfig, choose_triples


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
    if len(source) < 4 or _largest_square(source, target, w) <= limit:
        return everyone
    triples = choose_triples(source, config.triples, seed)
    if len(triples) == 0:
        return everyone
    squares = _squares(_triangle_motions(source[triples], target[triples]), source, target)
    best = int(np.argmin(np.minimum(squares, limit) @ w))
    inliers = squares[best] <= limit
    inliers[triples[best]] = True
    grown = _squares(kabsch(source, target, w * inliers), source, target) <= limit
    return grown if np.count_nonzero(grown) > np.count_nonzero(inliers) else inliers


def _largest_square(source: np.ndarray, target: np.ndarray, weights: np.ndarray) -> float:
    """Returns the largest squared distance that the best rigid motion of all points leaves.

    `kabsch` without its checks and without making a transform, as it runs at every control tick.
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
    return float(np.einsum("ni,ni->n", errors, errors).max())


def _triangle_motions(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Returns motions (K, 4, 4) between triangles (K, 3, 3) by their frames.

    As good a proposal as Kabsch's, and several times as fast as that many decompositions.
    """
    source_frames, target_frames = _triangle_frames(source), _triangle_frames(target)
    R = target_frames @ source_frames.swapaxes(-1, -2)
    source_centroids = source.sum(axis=1) / 3.0
    target_centroids = target.sum(axis=1) / 3.0
    return make_transform(R, target_centroids - (R @ source_centroids[..., None])[..., 0])


def _triangle_frames(corners: np.ndarray) -> np.ndarray:
    """Returns rotations (K, 3, 3): along the first side, in the plane, and normal to it."""
    first = corners[:, 1] - corners[:, 0]
    normal = np.cross(first, corners[:, 2] - corners[:, 0])
    frames = np.stack([first, np.cross(normal, first), normal], axis=-1)
    lengths = np.sqrt(np.einsum("kij,kij->kj", frames, frames))
    # Target triangles may be degenerate, and propose nothing sensible then.
    return frames / np.maximum(lengths, 1e-12)[:, None]


def _squares(X: np.ndarray, source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Returns the squared distances (..., N) of X source from target."""
    errors = transform_points(X, source) - target
    return np.einsum("...ni,...ni->...n", errors, errors)
