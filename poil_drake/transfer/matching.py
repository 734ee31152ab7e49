"""Matchings of the demonstrated part with the target's, and the references that they give."""

from dataclasses import dataclass

import numpy as np

from poil_drake.control.reference.make_reference import make_reference
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import TransferError
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.transfer.demonstration_tracks import DemonstrationTracks


@dataclass(frozen=True, eq=False)
class Matching:
    """One way in which the demonstrated part matches the target's.

    Attributes:
        target_points: (N, 3) the points on the target's part, before it moves [m, world].
        reference: The reference of the target points.
        cost: Cost of the coarse alignment; likelier matchings cost less.
    """

    target_points: np.ndarray
    reference: PointTrajectory
    cost: float


def transferred_positions(
    target_points: np.ndarray, tracks: DemonstrationTracks, *, posed_by: np.ndarray | None = None
) -> np.ndarray:
    """Returns where the demonstrated motion takes the target's points.

    At each time the Kabsch method aligns the points rigidly with the tracked ones, with the
    tracker's confidence as weights (POIL section III-A).

    Args:
        target_points: (N, 3) [m, world].
        tracks: Motion of the N demonstrated points.
        posed_by: (N, 3) points to align instead of the target points [m, world]. The target points
            then move along rigidly. None aligns the target points.

    Returns:
        (T, N, 3) [m, world]; NaN at times at which fewer than 3 points were observed.
    """
    source = target_points if posed_by is None else posed_by
    usable = np.count_nonzero(tracks.confidence > 0.0, axis=1) >= 3
    positions = np.full(tracks.positions.shape, np.nan)
    if np.any(usable):
        tracked = tracks.positions[usable]
        X = kabsch(np.broadcast_to(source, tracked.shape), tracked, tracks.confidence[usable])
        moved = np.broadcast_to(target_points, tracked.shape)
        positions[usable] = transform_points(X, moved)
    return positions


def make_matching_reference(
    target_points: np.ndarray, tracks: DemonstrationTracks, *, posed_by: np.ndarray | None = None
) -> PointTrajectory:
    """Returns the reference that takes the target's points along the demonstrated motion.

    The arguments are those of `transferred_positions`.

    Raises:
        TransferError: if too little of the demonstration was tracked, or nothing moves in it.
    """
    positions = transferred_positions(target_points, tracks, posed_by=posed_by)
    usable = np.isfinite(positions).all(axis=(1, 2))
    if np.count_nonzero(usable) < 2:
        raise TransferError(
            f"Only {np.count_nonzero(usable)} of {len(usable)} frames of the demonstration have at "
            "least three tracked points; two frames are needed.",
            remedy="Record the demonstration with the part in view, or change poil.tracker.",
        )
    return make_reference(tracks.times[usable], positions[usable])
