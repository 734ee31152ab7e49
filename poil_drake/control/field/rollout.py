"""Rollouts of the field: the motion of a rigid object that follows it freely."""

from typing import Any, NamedTuple

import numpy as np

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus, point_set_bcsdm
from poil_drake.control.field.twist_fit import scale_twist
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import TrackingError
from poil_drake.geometry.rigid_transform import moved_by_twist, transform_points


class Rollout(NamedTuple):
    """A simulated run of the field.

    Attributes:
        times: (T,) [s], from 0 in even steps.
        X_W: (T, 4, 4) motion of the object since the start, in the world: a point that starts at p
            is at X_W[t] p, and a body that starts at X_WB is at X_W[t] X_WB.
        potentials: (T,) D of POIL eq. 4 at each step [m^2].
        taus: (T,) time of the closest configuration of the reference at each step [s].
        converged: Whether the end of the reference was reached.
    """

    times: np.ndarray
    X_W: np.ndarray
    potentials: np.ndarray
    taus: np.ndarray
    converged: bool


def rollout(points: np.ndarray, *args: Any, **kwargs: Any) -> Rollout:
    """Returns the rollout from one start (N, 3) [m, world]; see `rollouts` for the arguments."""
    return rollouts(points[None], *args, **kwargs)[0]


def rollouts(
    points: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    time_step: float = 1.0 / 32.0,
    max_time: float = 60.0,
    *,
    max_angular_speed: float = np.inf,
    max_linear_speed: float = np.inf,
) -> list[Rollout]:
    """Returns rollouts of the field from many starts, until the reference's end or `max_time`.

    In each step the object turns about its centroid with the field's angular velocity (exponential
    map) while the centroid moves straight. One factor scales the whole twist to the speed limits.

    Args:
        points: (B, N, 3) positions at the starts [m, world].
        reference: The reference of the same N points.
        config: Parameters of the field.
        time_step: Length of a step [s].
        max_time: Longest simulated time [s].
        max_angular_speed: Limit on |omega| [rad/s].
        max_linear_speed: Limit on the centroid's speed [m/s].

    Raises:
        TrackingError: if the points of a start do not determine a motion (fewer than 3, or
            collinear).
    """
    points = np.asarray(points, dtype=float)
    B = len(points)
    X, taus, potentials = np.tile(np.eye(4), (B, 1, 1)), np.full(B, np.nan), np.full(B, np.nan)
    lengths, moving = np.zeros(B, dtype=int), np.ones(B, dtype=bool)
    history: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for _ in range(int(max_time / time_step) + 1):
        rows = np.flatnonzero(moving)
        if len(rows) == 0:
            break
        here = transform_points(X[rows], points[rows])
        field = point_set_bcsdm(here, reference, config, previous_tau=taus[rows])
        lost = rows[field.status == BcsdmStatus.LOST]
        if len(lost) > 0:
            raise TrackingError(
                f"At the starts with indices {lost.tolist()}, the {points.shape[1]} points do not "
                "determine a motion.",
                remedy="Pass at least three finite points that are not collinear.",
            )
        taus[rows], potentials[rows] = field.tau, field.potential
        lengths[rows] += 1
        history.append((X.copy(), potentials.copy(), taus.copy()))
        V = scale_twist(field.twist, max_angular_speed, max_linear_speed)
        moving[rows] = unfinished = field.status != BcsdmStatus.GOAL
        stepped = moved_by_twist(X[rows], V, field.centroid, time_step)
        X[rows[unfinished]] = stepped[unfinished]
    motions, all_potentials, all_taus = (np.array(column) for column in zip(*history, strict=True))
    return [
        Rollout(
            times=time_step * np.arange(length),
            X_W=motions[:length, b],
            potentials=all_potentials[:length, b],
            taus=all_taus[:length, b],
            converged=not moving[b],
        )
        for b, length in enumerate(lengths.tolist())
    ]
