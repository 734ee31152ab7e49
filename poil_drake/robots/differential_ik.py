"""Differential inverse kinematics: joint velocities that keep the direction of a twist."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.robots.joint_limits import JointLimits
from poil_drake.robots.panda import NOMINAL_POSTURE

_RANK_TOLERANCE = 1e-6
"""Relative tolerance below which a singular value, or the residual of the twist, counts as zero."""

_FLAT = 1e-12
"""Components of joint-space directions whose absolute values are below this count as zero."""

_LENGTH = 0.1
"""Length that converts angular to linear speeds when twists are compared [m]: about the distance
between the gripper and the object's points."""


@dataclass(frozen=True, kw_only=True)
class DifferentialInverseKinematicsConfig:
    """Margins and gains of the differential inverse kinematics.

    Attributes:
        nominal_posture: (n,) joint positions towards which the null-space motion pulls [rad].
        centering_gain: Speed of the pull per distance [1/s]; slow compared with the task.
        centering_speed: Largest speed of the pull [rad/s].
        position_margin: Distance to keep from the joint limits [rad]; the Panda's own controller
            stops the arm at the limits.
        braking_gain: Largest speed of a joint per remaining distance to the margin [1/s]. At
            1 rad/s, a gain of 5/s needs 5 rad/s^2, which the weakest joint can produce.
        velocity_scale: Fraction of the joints' speed limits that is used.
        acceleration_scale: Fraction of the joints' acceleration limits that is used.
    """

    nominal_posture: tuple[float, ...] = tuple(NOMINAL_POSTURE.tolist())
    centering_gain: float = 1.0
    centering_speed: float = 0.3
    position_margin: float = 0.05
    braking_gain: float = 5.0
    velocity_scale: float = 0.9
    acceleration_scale: float = 0.8


class ResolvedTwist(NamedTuple):
    """Joint velocities for a twist.

    Attributes:
        velocity: (n,) joint velocities [rad/s].
        scale: The fraction of the twist that `velocity` achieves, in [0, 1]; 1 for a zero twist.
        reachable_scale: The fraction that is possible without acceleration limits; 0 if the arm is
            stuck.
    """

    velocity: np.ndarray
    scale: float
    reachable_scale: float


def resolve_twist(
    V_WG: np.ndarray,
    J: np.ndarray,
    positions: np.ndarray,
    previous: np.ndarray,
    limits: JointLimits,
    config: DifferentialInverseKinematicsConfig,
    time_step: float,
) -> ResolvedTwist:
    """Returns the next joint velocities to command.

    There are two steps. (1) `direction_preserving_velocity`: J qdot = a V_WG with the largest a
    in [0, 1] that the joints' speed limits (reduced near position limits) allow, and a pull to the
    nominal posture in the null space of J. (2) `approach_velocity`: ONE factor shortens the change
    from `previous` to that velocity until every joint respects its acceleration limit. So the
    twist has the desired direction if the arm starts from rest and the direction is steady. When
    the direction changes, the command moves along a line in joint space to the new velocity.

    A zero twist brings the arm to rest, including its motion in the null space.

    Args:
        V_WG: (6,) desired (ω [rad/s], v [m/s]) of the gripper frame, in the world.
        J: (6, n) Jacobian, V_WG = J qdot, n <= 7.
        positions: (n,) measured joint positions [rad].
        previous: (n,) velocities commanded one time step ago [rad/s].
        limits: Limits of the joints.
        config: Margins and gains.
        time_step: Time between two commands [s].
    """
    lowest, highest = limits.velocity_bounds(
        positions, margin=config.position_margin, braking_gain=config.braking_gain
    )
    pull = config.centering_gain * (np.asarray(config.nominal_posture) - positions)
    wanted, reachable = direction_preserving_velocity(
        V_WG,
        J,
        pull,
        config.velocity_scale * lowest,
        config.velocity_scale * highest,
        config.centering_speed,
    )
    velocity = approach_velocity(
        previous, wanted, config.acceleration_scale * limits.acceleration, time_step
    )
    return ResolvedTwist(velocity, achieved_fraction(V_WG, J @ velocity), reachable)


def direction_preserving_velocity(
    V: np.ndarray,
    J: np.ndarray,
    pull: np.ndarray,
    lowest: np.ndarray,
    highest: np.ndarray,
    pull_speed: float,
) -> tuple[np.ndarray, float]:
    """Returns qdot (n,) [rad/s] and the largest a in [0, 1] with J qdot = a V within bounds.

    Of all such qdot it is the one closest to `pull`. Drake's `DoDifferentialInverseKinematics`
    poses the same problem, but its solver, OSQP, takes milliseconds and fails near joint limits.
    With one redundant joint, qdot = a J^+ V + z w, where w spans the null space of J. A linear
    program in the plane (a, z) remains; eliminating z (Fourier-Motzkin) solves it exactly.

    Args:
        V: (6,) the desired twist.
        J: (6, n) Jacobian, n <= 7.
        pull: (n,) desired velocities in the null space [rad/s].
        lowest: (n,) lowest joint velocities, at most 0 [rad/s].
        highest: (n,) highest joint velocities, at least 0 [rad/s].
        pull_speed: Largest speed in the null space [rad/s]. It never exceeds |J^+ V|, so that the
            pull fades out with the twist.
    """
    rows, n = J.shape
    U, S, Vt = np.linalg.svd(J)
    r = int(np.count_nonzero(S / S[0] > _RANK_TOLERANCE))
    task = ((V @ U[:, :r]) / S[:r]) @ Vt[:r]
    null = Vt[-1] if n > r else np.zeros(n)
    span = min(pull_speed, float(np.linalg.norm(task)))
    wanted_z = min(max(float(null @ pull), -span), span)

    # For the joints that z moves, the bounds are lower <= slope a + z <= upper; for the others,
    # they are lowest <= task a <= highest.
    moved = np.abs(null) > _FLAT
    slope = task[moved] / null[moved]
    ends = np.array([lowest[moved], highest[moved]]) / null[moved]
    lower, upper = ends.min(axis=0), ends.max(axis=0)
    flat, flat_lowest, flat_highest = task[~moved], lowest[~moved], highest[~moved]

    def range_of_z(a: float) -> tuple[float, float]:
        low = (lower - slope * a).max(initial=-np.inf)
        return float(low), float((upper - slope * a).min(initial=np.inf))

    # An arm of full rank can produce every twist.
    residual = J @ task - V
    possible = r == rows or np.linalg.norm(residual) <= _RANK_TOLERANCE * np.linalg.norm(V)
    a = 1.0 if possible else 0.0
    low, high = range_of_z(a)
    if low > high or ((flat_lowest > a * flat) | (a * flat > flat_highest)).any():
        used = np.abs(flat) > _FLAT
        limits = np.where(flat > 0.0, flat_highest, flat_lowest)[used] / flat[used]
        a = float(limits.min(initial=1.0))
        steeper = slope[:, None] - slope
        crossings = (upper[:, None] - lower)[steeper > _FLAT] / steeper[steeper > _FLAT]
        a = float(crossings.min(initial=a))
        low, high = range_of_z(a)
    if low > high:  # by rounding
        low = high = 0.5 * (low + high)
    z = min(max(wanted_z, low), high)
    return np.minimum(np.maximum(a * task + z * null, lowest), highest), a


def approach_velocity(
    previous: np.ndarray, wanted: np.ndarray, acceleration: np.ndarray, time_step: float
) -> np.ndarray:
    """Returns the velocity (n,) [rad/s] after one step on the line from `previous` to `wanted`.

    Args:
        previous: (n,) current velocities, at which the line begins [rad/s].
        wanted: (n,) target velocities [rad/s].
        acceleration: (n,) largest accelerations [rad/s^2], which bound the change.
        time_step: Duration of the step [s].
    """
    change = wanted - previous
    excess = np.abs(change / (acceleration * time_step)).max(initial=0.0)
    return wanted if excess <= 1.0 else previous + change / excess


def achieved_fraction(wanted: np.ndarray, achieved: np.ndarray) -> float:
    """Returns the fraction, in [0, 1], of the twist `wanted` (6,) that `achieved` (6,) attains.

    The function projects `achieved` onto `wanted`, with angular speeds multiplied by 0.1 m. The
    fraction is 1 if `wanted` is zero. Twists are (ω [rad/s], v [m/s]).
    """
    square = _LENGTH**2 * float(wanted[:3] @ wanted[:3]) + float(wanted[3:] @ wanted[3:])
    product = _LENGTH**2 * float(wanted[:3] @ achieved[:3]) + float(wanted[3:] @ achieved[3:])
    return min(max(product / square, 0.0), 1.0) if square > 0.0 else 1.0
