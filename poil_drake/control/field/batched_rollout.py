"""Rollouts of the field from many starts at once."""

import numpy as np

from poil_drake.control.field.batched_field import batched_field
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus
from poil_drake.control.field.rollout import Rollout
from poil_drake.control.field.twist_fit import scale_twist, shift_twist
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.geometry.rigid_transform import moved_by_twist, transform_points


def batched_rollout(
    points: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    time_step: float = 1.0 / 32.0,
    max_time: float = 60.0,
    *,
    max_angular_speed: float = np.inf,
    max_linear_speed: float = np.inf,
    limited_points: np.ndarray | None = None,
) -> list[Rollout]:
    """Returns `rollout` of B starts, up to rounding; each run ends as soon as its object arrives.

    Args:
        points: (B, N, 3) positions at the starts [m, world].
        reference: The reference of the same N points.
        config: Parameters of the field.
        time_step: Length of a step [s].
        max_time: Longest simulated time [s].
        max_angular_speed: Limit of |omega| [rad/s].
        max_linear_speed: Limit of the speed of `limited_points` [m/s].
        limited_points: (B, 3) points that move with the objects, such as the gripper's origin, at
            the starts [m, world]; None for the centroids of the points.

    Raises:
        TrackingError: if the points of a start do not determine a motion (fewer than 3, or
            collinear).
    """
    if not (time_step > 0.0 and max_time >= 0.0):
        raise InvalidValueError(
            f"batched_rollout() got time_step={time_step} s and max_time={max_time} s.",
            remedy="Pass a positive time_step and a non-negative max_time.",
        )
    points = np.asarray(points, dtype=float)
    B = len(points)
    if B == 0:
        return []
    X = np.tile(np.eye(4), (B, 1, 1))
    taus, potentials = np.full(B, np.nan), np.full(B, np.nan)
    lengths, moving = np.zeros(B, dtype=int), np.ones(B, dtype=bool)
    history: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for _ in range(int(max_time / time_step) + 1):
        rows = np.flatnonzero(moving)
        if len(rows) == 0:
            break
        field = batched_field(
            transform_points(X[rows], points[rows]), reference, config, previous_tau=taus[rows]
        )
        lost = rows[field.status == BcsdmStatus.LOST]
        if len(lost) > 0:
            raise TrackingError(
                f"The points of the starts {lost.tolist()} do not determine a motion.",
                remedy="Pass at least three finite points that are not collinear.",
            )
        taus[rows], potentials[rows] = field.tau, field.potential
        lengths[rows] += 1
        history.append((X.copy(), potentials.copy(), taus.copy()))
        arms = np.zeros((len(rows), 3))
        if limited_points is not None:
            limited = transform_points(X[rows], limited_points[rows][:, None])[:, 0]
            arms = limited - field.centroid
        V = shift_twist(field.twist, arms)
        V = shift_twist(scale_twist(V, max_angular_speed, max_linear_speed), -arms)
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
