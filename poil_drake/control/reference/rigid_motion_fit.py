"""Fits the motion of one rigid shape to tracked points."""

from collections.abc import Callable

import numpy as np

from poil_drake.errors import TransferError
from poil_drake.geometry.rigid_fit import kabsch, rigid_inliers
from poil_drake.geometry.rigid_transform import inverse, transform_points

_START = 3
"""A point that is an outlier in this many first samples changes its place on the shape afterwards,
because the shape is that of most samples."""


def fit_rigid_motion(
    positions: np.ndarray, inlier_distance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the rigid shape, and its poses, that fit tracked points best.

    Generalised Procrustes analysis: poses are fitted to the shape and the shape to the poses, in
    turn. Neither fit includes a sample's outliers.

    Args:
        positions: (T, N, 3) tracked positions [m, world]; NaN where a point was not observed.
        inlier_distance: Largest distance of an inlier from its place on the shape [m].

    Returns:
        body: (N, 3) the shape about its centroid [m].
        X: (U, 4, 4) the shape's pose in each usable sample.
        usable: (T,) bool, the U samples with at least three points.

    Raises:
        TransferError: if fewer than 4 samples are usable, no sample has all points, or a point
            changes its place on the shape after the start.
    """
    seen = np.isfinite(positions).all(axis=2)
    usable = seen.sum(axis=1) >= 3
    complete = np.flatnonzero(seen.all(axis=1))
    if usable.sum() < 4 or complete.size == 0:
        raise TransferError(
            f"Of {len(positions)} samples, {usable.sum()} have three points or more, and "
            f"{complete.size} have all points.",
            remedy="Track at least 4 samples with three points, one of them with all points.",
        )
    body = positions[complete[0]] - positions[complete[0]].mean(axis=0)
    positions, seen = positions[usable], seen[usable]
    positions = np.where(seen[..., None], positions, 0.0)
    # The median shape, because a point may be mistracked for many successive samples.
    body, X = _procrustes(body, positions, seen, np.nanmedian)
    errors = np.linalg.norm(transform_points(X, body) - positions, axis=2)
    counted = seen.copy()
    for k in np.flatnonzero(np.any(seen & (errors > inlier_distance), axis=1)):
        present = np.flatnonzero(seen[k])
        counted[k, present] = rigid_inliers(
            body[present], positions[k, present], np.ones(present.size), inlier_distance
        )
    strays = np.flatnonzero(seen[:_START].any(axis=0) & ~counted[:_START].any(axis=0))
    if strays.size > 0:
        raise TransferError(
            f"Relative to the other points, the points {strays.tolist()} move by up to "
            f"{1e3 * errors[:, strays][seen[:, strays]].max():.0f} mm after the start: they drift, "
            "or change places.",
            remedy="Leave these points out, or track the demonstration again, e.g. more slowly.",
        )
    body, X = _procrustes(body, positions, counted, np.nanmean)
    return body, X, usable


def _procrustes(
    body: np.ndarray,
    positions: np.ndarray,
    counted: np.ndarray,
    average: Callable[..., np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Returns shape and poses after three rounds, which converge far below the points' noise.

    `body` is the first guess of the shape, `counted` (U, N) leaves out outliers, and `average`
    combines the positions of a point relative to the shape.
    """
    weights = counted.astype(float)
    ever = counted.any(axis=0)
    for _ in range(3):
        X = kabsch(np.broadcast_to(body, positions.shape), positions, weights)
        in_body = transform_points(inverse(X), positions)
        in_body[~counted] = np.nan
        # A point that never counts keeps its position.
        body[ever] = average(in_body[:, ever], axis=0)
        body = body - body.mean(axis=0)
    return body, kabsch(np.broadcast_to(body, positions.shape), positions, weights)
