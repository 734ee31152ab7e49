"""Straight gripper motions without rotation: lift after the grasp, retreat after release."""

import math
from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.rigid_transform import rotation_log


@dataclass(frozen=True, kw_only=True)
class StraightMotionConfig:
    """Speed, acceleration and gain of straight motions.

    Attributes:
        speed: Cruising speed [m/s].
        acceleration: Acceleration and deceleration [m/s^2].
        gain: Feedback gain on position and orientation [1/s].
    """

    speed: float = 0.1
    acceleration: float = 0.4
    gain: float = 5.0


def trapezoid(
    distance: float, elapsed: float, speed: float, acceleration: float
) -> tuple[float, float, float]:
    """Returns the distance covered [m], the speed [m/s] and the total duration [s] of a motion.

    The speed has a trapezoidal profile: the motion starts and ends at rest.

    Args:
        distance: Distance to cover, >= 0 [m].
        elapsed: Time since the start [s].
        speed: Cruising speed [m/s].
        acceleration: Acceleration and deceleration [m/s^2].
    """
    ramp = min(speed / acceleration, math.sqrt(distance / acceleration))
    top = acceleration * ramp
    cruise = max(distance - top * ramp, 0.0) / top if top > 0.0 else 0.0
    total = 2.0 * ramp + cruise
    t = min(max(elapsed, 0.0), total)
    if t < ramp:
        return 0.5 * acceleration * t**2, acceleration * t, total
    if t < ramp + cruise:
        return 0.5 * top * ramp + top * (t - ramp), top, total
    left = total - t
    return distance - 0.5 * acceleration * left**2, acceleration * left, total


def straight_motion_twist(
    X_WStart: np.ndarray,
    X_WG: np.ndarray,
    direction: np.ndarray,
    distance: float,
    elapsed: float,
    config: StraightMotionConfig,
) -> np.ndarray:
    """Returns the spatial velocity (6,) (ω [rad/s], v [m/s]) of the gripper in the world.

    It is the velocity of a straight motion without rotation, plus feedback on the pose's error.

    Args:
        X_WStart: (4, 4) gripper pose when the motion began.
        X_WG: (4, 4) gripper pose now.
        direction: (3,) unit direction in the world.
        distance: Distance to cover [m].
        elapsed: Time since the motion began [s].
        config: Speed, acceleration and gain.
    """
    covered, speed, _ = trapezoid(distance, elapsed, config.speed, config.acceleration)
    p_wanted = X_WStart[:3, 3] + covered * direction
    omega = config.gain * rotation_log(X_WStart[:3, :3] @ X_WG[:3, :3].T)
    v = speed * direction + config.gain * (p_wanted - X_WG[:3, 3])
    return np.concatenate([omega, v])


def straight_motion_duration(distance: float, config: StraightMotionConfig) -> float:
    """Returns how long a straight motion over a distance [m] takes [s]."""
    return trapezoid(distance, 0.0, config.speed, config.acceleration)[2]
