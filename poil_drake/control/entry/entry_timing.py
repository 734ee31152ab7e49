"""Joins a transit and the rest of the demonstration into a reference that starts at the object."""

import numpy as np

from poil_drake.control.reference.point_trajectory import (
    PointTrajectory,
    rigid_velocities,
    rms_length,
)
from poil_drake.control.reference.pose_smoothing import interpolate_poses
from poil_drake.geometry.rigid_transform import inverse, rotation_log, transform_points

# Speeds are root mean square over the points.
SPEED = 0.15
"""Cruising speed [m/s]; a demonstration's is 0.1 to 0.25."""

ANGULAR_SPEED = 1.0
"""Limit on the angular speed [rad/s], which `SPEED` hardly bounds if points are close together."""

ACCELERATION = 0.3
"""Acceleration of the points [m/s^2]. They reach the cruising speed in half a second."""

_INITIAL_SPEED = 0.02
"""Speed at the start [m/s]. Zero would be an equilibrium of the field."""

_SAMPLE_PERIOD = 1.0 / 32.0
"""Time between samples [s], the same as in demonstrated references."""


def extended_reference(
    reference: PointTrajectory, poses: np.ndarray, index: int
) -> PointTrajectory:
    """Returns a reference that follows a transit and then the demonstration from a sample on.

    On the transit the points keep the shape that they have at this sample, so that they do not jump
    there. The transit arrives with the demonstration's speed, but at most the cruising speed. Its
    velocities are those of rigid motions and never zero, so the field advances everywhere up to the
    reference's end.

    Args:
        reference: The demonstration.
        poses: (K, 4, 4) poses of the object on the transit [m, world]; the last is its pose at the
            sample.
        index: The sample of the demonstration at which the transit ends.
    """
    shape = reference.positions[index]
    motions = poses @ inverse(poses[-1])
    lengths = _lengths(motions, shape)
    kept = np.r_[True, lengths > 1e-9]
    motions, along = motions[kept], np.concatenate([[0.0], np.cumsum(lengths[lengths > 1e-9])])
    if len(along) < 2:
        # A reference needs two samples, so at the goal it begins one sample earlier.
        index = min(index, len(reference.times) - 2)
        times = reference.times[index:] - reference.times[index]
        return PointTrajectory(times, reference.positions[index:], reference.velocities[index:])
    velocity = reference.velocities[index]
    even = np.linspace(0.0, along[-1], 4 * len(along))
    passed = _passing_times(even, float(rms_length(velocity)))
    count = max(2, int(np.ceil(passed[-1] / _SAMPLE_PERIOD)))
    times = np.linspace(0.0, passed[-1], count + 1)
    motions = interpolate_poses(along, motions, np.interp(times, passed, even))
    positions = transform_points(motions, shape)
    velocities = rigid_velocities(motions, positions.mean(axis=1), positions, times[1])
    positions[-1] = shape
    velocities[-1] = velocity
    return PointTrajectory(
        np.concatenate([times, times[-1] + reference.times[index + 1 :] - reference.times[index]]),
        np.concatenate([positions, reference.positions[index + 1 :]]),
        np.concatenate([velocities, reference.velocities[index + 1 :]]),
    )


def _lengths(motions: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Returns the length (K - 1,) [m] of each step: the points' path, or the turn if it is longer.

    A turn is as long as the distance that the cruising speed covers in the time of the turn.
    """
    moved = rms_length(np.diff(transform_points(motions, shape), axis=0))
    turns = rotation_log(motions[1:, :3, :3] @ motions[:-1, :3, :3].swapaxes(-1, -2))
    return np.maximum(moved, np.linalg.norm(turns, axis=1) * SPEED / ANGULAR_SPEED)


def _passing_times(along: np.ndarray, end_speed: float) -> np.ndarray:
    """Returns the times (M,) [s] at which the motion passes lengths (M,) [m].

    With the acceleration a, v^2 grows by at most 2 a s over a length s, forwards from the start and
    backwards from the end.
    """
    growth = 2.0 * ACCELERATION
    squares = np.minimum(_INITIAL_SPEED**2 + growth * along, SPEED**2)
    squares = np.minimum(squares, end_speed**2 + growth * (along[-1] - along))
    v = np.sqrt(squares)
    return np.concatenate([[0.0], np.cumsum(2.0 * np.diff(along) / (v[1:] + v[:-1]))])
