"""From the twist wanted of the gripper to the velocities of the joints, direction kept."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.robots.joint_limits import JointLimits

PANDA_READY_POSTURE = (0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4)
"""The Panda's usual rest posture [rad]: elbow bent, hand down, far from limits."""

# Singular values below this fraction of the largest count as zero, and so does what is left of a
# twist that the arm cannot produce.
_RANK_TOLERANCE = 1e-6
# A null-space direction or a task direction that moves a joint less than this is vertical or
# horizontal in the plane of the linear program.
_FLAT = 1e-12


@dataclass(frozen=True, kw_only=True)
class TwistResolutionConfig:
    """How a twist becomes joint velocities.

    Attributes:
        nominal_posture: (n,) joint positions that the spare freedom pulls towards [rad].
        centering_gain: Speed of that pull per distance [1/s]; slow against the task.
        centering_speed: Largest speed of that pull [rad/s].
        position_margin: Distance kept from the joint limits [rad]; the Panda's own controller
            stops the arm at the limits.
        braking_gain: A joint approaches its limit at most this fast per distance left [1/s].
            5/s times 1 rad/s is a deceleration within what the weakest joint can do.
        velocity_scale: Fraction of the joints' speed limits that is used.
        acceleration_scale: Fraction of the joints' acceleration limits that is used.
        length: Turns angular into linear speed where twists are compared [m]; about the distance
            between the gripper and the object's points.
    """

    nominal_posture: tuple[float, ...] = PANDA_READY_POSTURE
    centering_gain: float = 1.0
    centering_speed: float = 0.3
    position_margin: float = 0.05
    braking_gain: float = 5.0
    velocity_scale: float = 0.9
    acceleration_scale: float = 0.8
    length: float = 0.1


class ResolvedTwist(NamedTuple):
    """Joint velocities for a twist.

    Attributes:
        velocity: (n,) [rad/s].
        scale: Which fraction of the twist they achieve, in [0, 1]; 1 for a twist of zero.
        reachable_scale: The fraction without the acceleration limits: 0 where the arm is stuck.
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
    config: TwistResolutionConfig,
    time_step: float,
) -> ResolvedTwist:
    """Returns the joint velocities to command now.

    Two steps. (1) `direction_preserving_velocity`: J qdot = a V with the largest a in [0, 1] that
    the joints' speeds (reduced near position limits) allow, and a pull to the nominal posture in
    the null space of J. (2) `approach_velocity`: the change from `previous` to that is shortened by
    ONE factor until every joint's acceleration is allowed. So the direction of the twist is kept
    from rest and along a steady direction; where the wanted direction changes, the command goes
    straight, in joint space, from the old velocity to the new one.

    A twist of zero brings the arm to rest, the null space included.

    Args:
        V_WG: (6,) wanted (ω [rad/s], v [m/s]) of the gripper frame, in the world.
        J: (6, n) V_WG = J qdot, n <= 7.
        positions: (n,) measured joint positions [rad].
        previous: (n,) velocities commanded one time step ago [rad/s].
        limits: What the joints may do.
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
    return ResolvedTwist(velocity, achieved_fraction(V_WG, J @ velocity, config.length), reachable)


def direction_preserving_velocity(
    V: np.ndarray,
    J: np.ndarray,
    pull: np.ndarray,
    lowest: np.ndarray,
    highest: np.ndarray,
    pull_speed: float,
) -> tuple[np.ndarray, float]:
    """Returns qdot (n,) and the largest a in [0, 1] with J qdot = a V within the bounds.

    Of all such qdot it is the one closest to `pull`. It is the problem that Drake's
    `DoDifferentialInverseKinematics` poses, which OSQP there fails to solve, after milliseconds,
    close to joint limits. With one spare joint qdot = a J^+ V + z n, where n spans the null space
    of J; a linear program in the plane (a, z) remains, and eliminating z (Fourier-Motzkin) solves
    it exactly.

    Args:
        V: (6,) the wanted twist.
        J: (6, n), n <= 7.
        pull: (n,) velocities wanted in the null space [rad/s].
        lowest: (n,) not above 0 [rad/s].
        highest: (n,) not below 0 [rad/s].
        pull_speed: The null-space velocity is no longer than this [rad/s], nor than |J^+ V|, so
            that it fades out with the twist.
    """
    rows, n = J.shape
    U, S, Vt = np.linalg.svd(J)
    threshold = _RANK_TOLERANCE * S[0]
    r = sum(s > threshold for s in S.tolist())
    task = ((V @ U[:, :r]) / S[:r]) @ Vt[:r]
    null = Vt[-1] if n > r else np.zeros(n)
    span = min(pull_speed, math.sqrt(task @ task))
    wanted_z = min(max(float(null @ pull), -span), span)

    strips, flat = _strips(task, null, lowest, highest)
    # With full rank the arm can produce every twist.
    a = 0.0 if r < rows and _differ(J @ task, V) else 1.0
    low, high = _range_of_second(strips, a)
    if low > high or any(not lower <= a * g <= upper for g, lower, upper in flat):
        a = _largest_first(strips, flat)
        low, high = _range_of_second(strips, a)
    if low > high:  # by rounding
        low = high = 0.5 * (low + high)
    z = min(max(wanted_z, low), high)
    return np.minimum(np.maximum(a * task + z * null, lowest), highest), a


# One joint's bounds: (slope, lower, upper).
_Bounds = list[tuple[float, float, float]]


def _strips(
    task: np.ndarray, null: np.ndarray, lowest: np.ndarray, highest: np.ndarray
) -> tuple[_Bounds, _Bounds]:
    """Returns the joints' bounds on (a, z): lowest <= task a + null z <= highest.

    As plain numbers: seven are quicker than arrays of seven.

    Returns:
        strips: Of joints that z moves, lower <= slope a + z <= upper.
        flat: Of the others, lower <= slope a <= upper.
    """
    strips, flat = [], []
    for g, h, lower, upper in zip(
        task.tolist(), null.tolist(), lowest.tolist(), highest.tolist(), strict=True
    ):
        if h > _FLAT:
            strips.append((g / h, lower / h, upper / h))
        elif h < -_FLAT:
            strips.append((g / h, upper / h, lower / h))
        else:
            flat.append((g, lower, upper))
    return strips, flat


def _differ(V: np.ndarray, wanted: np.ndarray) -> bool:
    difference = V - wanted
    return bool(difference @ difference > _RANK_TOLERANCE**2 * (wanted @ wanted))


def _largest_first(strips: _Bounds, flat: _Bounds) -> float:
    """Returns the largest a in [0, 1] for which some z is within all bounds."""
    a = 1.0
    for g, lower, upper in flat:
        if abs(g) > _FLAT:
            a = min(a, (upper if g > 0.0 else lower) / g)
    for below, lower, _ in strips:
        for above, _, upper in strips:
            slope = above - below
            if slope > _FLAT:
                a = min(a, (upper - lower) / slope)
    return a


def _range_of_second(strips: _Bounds, a: float) -> tuple[float, float]:
    """Returns the smallest and the largest z within the strips' bounds."""
    low, high = -math.inf, math.inf
    for slope, lower, upper in strips:
        low = max(low, lower - slope * a)
        high = min(high, upper - slope * a)
    return low, high


def approach_velocity(
    previous: np.ndarray, wanted: np.ndarray, acceleration: np.ndarray, time_step: float
) -> np.ndarray:
    """Returns the velocity (n,) on the straight line to `wanted` as near to it as allowed.

    Args:
        previous: (n,) velocities now, where the line begins [rad/s].
        wanted: (n,) velocities to reach [rad/s].
        acceleration: (n,) largest accelerations [rad/s^2].
        time_step: Time to move on [s].
    """
    change = wanted - previous
    excess = np.abs(change / (acceleration * time_step)).max(initial=0.0)
    return wanted if excess <= 1.0 else previous + change / excess


def achieved_fraction(wanted: np.ndarray, achieved: np.ndarray, length: float) -> float:
    """Returns the part of a wanted twist (6,) that `achieved` (6,) has, in [0, 1].

    It is the projection onto the wanted twist, with angular speeds times `length` [m]; 1 when
    nothing is wanted.
    """
    square = length**2 * float(wanted[:3] @ wanted[:3]) + float(wanted[3:] @ wanted[3:])
    product = length**2 * float(wanted[:3] @ achieved[:3]) + float(wanted[3:] @ achieved[3:])
    return min(max(product / square, 0.0), 1.0) if square > 0.0 else 1.0
