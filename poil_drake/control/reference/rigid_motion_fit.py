"""The motion of one rigid shape behind tracked points."""

from collections.abc import Callable

import numpy as np

from poil_drake.errors import TransferError
from poil_drake.geometry.rigid_consensus import RigidConsensusConfig, rigid_inliers
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import inverse, transform_points


def fit_rigid_motion(
    positions: np.ndarray, config: RigidConsensusConfig
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the rigid shape, and its poses, that fit tracked points best.

    Generalised Procrustes analysis: poses are fitted to the shape and the shape to the poses, in
    turn. Points that left the body in a sample do not count there.

    A reference has to be rigid: a rigid object cannot reach a shape that is not its own, so that D
    stays above zero and the goal's tolerance may never be met, and the field would follow the
    tracker's noise.

    Args:
        positions: (T, N, 3) tracked positions [m, world]; NaN where a point was not observed.
        config: When a point has left the body.

    Returns:
        body: (N, 3) the shape about its centroid [m].
        X: (U, 4, 4) its pose in each usable sample.
        usable: (T,) bool, the samples with three points or more.

    Raises:
        TransferError: if fewer than 4 samples are usable, or none has every point.
    """
    seen = np.isfinite(positions).all(axis=2)
    usable = seen.sum(axis=1) >= 3
    complete = np.flatnonzero(seen.all(axis=1))
    if usable.sum() < 4 or complete.size == 0:
        raise TransferError(
            f"Of {len(positions)} samples {usable.sum()} hold three points, {complete.size} hold "
            "all of them.",
            remedy="Track at least 4 samples, one of them with every point.",
        )
    body = positions[complete[0]] - positions[complete[0]].mean(axis=0)
    positions, seen = positions[usable], seen[usable]
    positions = np.where(seen[..., None], positions, 0.0)
    # The median shape, since a point may be off its place for many samples on end.
    body, X = _procrustes(body, positions, seen, np.nanmedian)
    errors = np.linalg.norm(transform_points(X, body) - positions, axis=2)
    counted = seen.copy()
    for k in np.flatnonzero(np.any(seen & (errors > config.inlier_distance), axis=1)):
        present = np.flatnonzero(seen[k])
        counted[k, present] = rigid_inliers(body[present], positions[k, present], config=config)
    body, X = _procrustes(body, positions, counted, np.nanmean)
    return body, X, usable


def _procrustes(
    body: np.ndarray,
    positions: np.ndarray,
    counted: np.ndarray,
    average: Callable[..., np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Returns shape and poses; three rounds settle them far below the noise."""
    weights = counted.astype(float)
    ever = counted.any(axis=0)
    for _ in range(3):
        X = kabsch(np.broadcast_to(body, positions.shape), positions, weights)
        in_body = transform_points(inverse(X), positions)
        in_body[~counted] = np.nan
        # A point that never counts keeps the place it has.
        body[ever] = average(in_body[:, ever], axis=0)
        body = body - body.mean(axis=0)
    return body, kabsch(np.broadcast_to(body, positions.shape), positions, weights)
