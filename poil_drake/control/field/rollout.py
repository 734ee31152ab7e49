"""Rollouts of the field: the motion of a rigid object that follows it freely."""

from dataclasses import dataclass

import numpy as np

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus, point_set_bcsdm
from poil_drake.control.field.twist_fit import scale_twist, shift_twist
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields
from poil_drake.geometry.rigid_transform import moved_by_twist, transform_points


@dataclass(frozen=True, eq=False)
class Rollout(SharedOnCopy):
    """A simulated run of the field.

    Attributes:
        times: (T,) [s], from 0 in even steps.
        X_W: (T, 4, 4) motion of the object since the start, in the world: a point that starts at p
            is at X_W[t] p, a body that starts at X_WB is at X_W[t] X_WB. The first is the identity.
        potentials: (T,) D of POIL eq. 4 at each step [m^2].
        taus: (T,) time of the closest configuration of the reference at each step [s].
        converged: Whether the end of the reference was reached.
    """

    times: np.ndarray
    X_W: np.ndarray
    potentials: np.ndarray
    taus: np.ndarray
    converged: bool

    def __post_init__(self) -> None:
        freeze_fields(self, times=("T",), X_W=("T", 4, 4), potentials=("T",), taus=("T",))


def rollout(
    points: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    time_step: float = 1.0 / 32.0,
    max_time: float = 60.0,
    *,
    max_angular_speed: float = np.inf,
    max_linear_speed: float = np.inf,
    limited_point: np.ndarray | None = None,
) -> Rollout:
    """Integrates the field until the end of the reference is reached or the time is over.

    In each step the object turns about its centroid with the field's angular velocity (exponential
    map) while the centroid moves straight. One factor scales both to the speed limits.

    Args:
        points: (N, 3) positions at the start [m, world].
        reference: The reference of the same N points.
        config: Parameters of the field.
        time_step: Length of a step [s].
        max_time: Longest simulated time [s].
        max_angular_speed: Limit of |omega| [rad/s].
        max_linear_speed: Limit of the speed of `limited_point` [m/s].
        limited_point: (3,) point that moves with the object, such as the gripper's origin, at the
            start [m, world]; None for the centroid of the points.

    Raises:
        TrackingError: if the points do not determine a motion (fewer than 3, or collinear).
    """
    if not (time_step > 0.0 and max_time >= 0.0):
        raise InvalidValueError(
            f"rollout() got time_step={time_step} s and max_time={max_time} s.",
            remedy="Pass a positive time_step and a non-negative max_time.",
        )
    points = np.asarray(points, dtype=float)
    X = np.eye(4)
    tau: float | None = None
    motions, potentials, taus = [], [], []
    converged = False
    for _ in range(int(max_time / time_step) + 1):
        output = point_set_bcsdm(transform_points(X, points), reference, config, previous_tau=tau)
        if output.status is BcsdmStatus.LOST:
            raise TrackingError(
                f"The {len(points)} points do not determine a motion.",
                remedy="Pass at least three finite points that are not collinear.",
            )
        tau = output.tau
        motions.append(X)
        potentials.append(output.potential)
        taus.append(tau)
        if output.status is BcsdmStatus.GOAL:
            converged = True
            break
        origin = output.centroid
        limited_now = origin if limited_point is None else transform_points(X, limited_point)
        limited = scale_twist(
            shift_twist(output.twist, limited_now - origin), max_angular_speed, max_linear_speed
        )
        X = moved_by_twist(X, shift_twist(limited, origin - limited_now), origin, time_step)
    return Rollout(
        times=time_step * np.arange(len(motions)),
        X_W=np.array(motions),
        potentials=np.array(potentials),
        taus=np.array(taus),
        converged=converged,
    )
