"""Time parameterization of joint paths."""

import numpy as np
from scipy.interpolate import CubicSpline

from poil_drake.errors import InvalidValueError
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda import ACCELERATION_LIMITS

VELOCITY_SCALE = 0.4
"""Fraction of the joint velocity limits that is used. The rest is left for the feedback that tracks
the trajectory."""

ACCELERATION_SCALE = 0.3  # Fraction of the joint acceleration limits that is used.

_SMOOTHING_TIME = 0.2
"""The motion is averaged over this time [s], which bounds the jerk. A real Panda stops with a
reflex error if its commands jump."""

_PATH_SAMPLES = 400  # Samples of the path at which its speed is bounded.
_SAMPLE_PERIOD = 1.0 / 64.0  # [s] Between the samples of the trajectory.
_FINE = 1e-3  # [s] Time step before the smoothing, far below any joint's time constant.


def time_joint_path(
    path: np.ndarray,
    velocity_limits: np.ndarray,
    *,
    min_duration: float = 0.0,
) -> JointTrajectory:
    """Returns a smooth motion along a joint path, from rest to rest.

    A cubic spline q(s) interpolates the path over its length s. The speed v = ds/dt keeps |q'| v
    within the velocity limits and |q''| v^2 within half of the acceleration limits, and |q'| dv/dt
    stays within the other half. A moving average over time then smooths the motion. It keeps the
    bounds on velocities and accelerations.

    Args:
        path: (K, 7) joint positions [rad], K >= 2, each different from the one before.
        velocity_limits: (7,) joint velocity limits [rad/s].
        min_duration: Shortest duration of the motion [s].

    Raises:
        InvalidValueError: if the path has fewer than two samples, or two successive equal ones.
    """
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    if len(path) < 2 or np.any(lengths == 0.0):
        raise InvalidValueError(
            f"The joint path has {len(path)} samples, {sum(lengths == 0.0)} of them equal to the "
            "one before.",
            remedy="Pass at least two samples, each different from the one before.",
        )
    spline = CubicSpline(np.concatenate([[0.0], np.cumsum(lengths)]), path)
    s = np.linspace(0.0, lengths.sum(), _PATH_SAMPLES)
    when = _passing_times(s, spline, velocity_limits)
    stretch = max((min_duration - _SMOOTHING_TIME) / when[-1], 1.0)
    half = 0.5 * _SMOOTHING_TIME
    duration = when[-1] * stretch + 2.0 * half
    count = max(int(np.ceil(duration / _SAMPLE_PERIOD)), 1)
    times = np.linspace(0.0, duration, count + 1)
    # A moving average is a difference of the unsmoothed motion's integral.
    fine = np.arange(-2.0 * half - _FINE, duration + 2.0 * half + _FINE, _FINE)
    motion = spline(np.interp(fine - half, when * stretch, s))
    integral = np.vstack([np.zeros(7), np.cumsum(0.5 * (motion[1:] + motion[:-1]), axis=0) * _FINE])
    positions, velocities = (
        (_at(times + half, fine, values) - _at(times - half, fine, values)) / _SMOOTHING_TIME
        for values in (integral, motion)
    )
    positions[0], positions[-1] = path[0], path[-1]
    velocities[0] = velocities[-1] = 0.0
    return JointTrajectory(times, positions, velocities)


def _passing_times(s: np.ndarray, spline: CubicSpline, velocity_limits: np.ndarray) -> np.ndarray:
    """Returns the times (M,) [s] at which the motion passes the path lengths s (M,) [rad]."""
    tiny = 1e-9
    first, second = np.abs(spline(s, 1)) + tiny, np.abs(spline(s, 2)) + tiny
    half = 0.5 * ACCELERATION_SCALE * np.array(ACCELERATION_LIMITS)
    squares = np.minimum(
        (VELOCITY_SCALE * velocity_limits / first).min(axis=1) ** 2,
        (half / second).min(axis=1),
    )
    gains = 2.0 * (half / first).min(axis=1)  # bounds d(v^2) / ds
    ds = s[1] - s[0]
    squares[0] = squares[-1] = 0.0
    for k in range(1, len(s)):
        squares[k] = min(squares[k], squares[k - 1] + gains[k - 1] * ds)
    for k in range(len(s) - 2, -1, -1):
        squares[k] = min(squares[k], squares[k + 1] + gains[k + 1] * ds)
    speeds = np.sqrt(squares)
    return np.concatenate([[0.0], np.cumsum(2.0 * ds / (speeds[1:] + speeds[:-1]))])


def _at(times: np.ndarray, grid: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(times, grid, values[:, k]) for k in range(values.shape[1])], axis=1)
