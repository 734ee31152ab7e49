"""Makes the reference that the controller follows from a demonstration's tracked points."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from poil_drake.control.reference.point_trajectory import (
    PointTrajectory,
    rigid_velocities,
    rms_length,
)
from poil_drake.control.reference.pose_smoothing import interpolate_poses, smooth_poses
from poil_drake.control.reference.rigid_motion_fit import fit_rigid_motion
from poil_drake.control.reference.timing import ReferenceConfig, retime, split_motion
from poil_drake.errors import TransferError
from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import (
    make_transform,
    rotation_exp,
    rotation_log,
    transform_points,
)

_ROUNDING_STEP = 1e-3
"""Spacing of the samples of a path whose hooks and corners are smoothed along its length [m]."""

_ROUNDING = 3
"""Standard deviation of the Gaussian filter that smooths such a path [samples]."""

_MAX_ROUNDS = 6
"""How often the filter is applied at most. Six times shorten a hook by 1.5 cm."""


def make_reference(
    times: np.ndarray, positions: np.ndarray, config: ReferenceConfig | None = None
) -> PointTrajectory:
    """Returns the reference for tracked points of one rigid object.

    One rigid shape is fitted to the points, and its motion is smoothed. Pauses are cut out, and the
    motion is led through the mean pose of each pause. The mean pose of the last pause is the goal.
    The motion is then resampled evenly in time, at the demonstrated speed within limits, and comes
    to rest at the end. All samples have the same rigid shape. All velocities are those of rigid
    motions, and the last are zero.

    Args:
        times: (T,) sample times [s], increasing.
        positions: (T, N, 3) tracked positions [m, world]; NaN where a point was not observed.
        config: Parameters; None for the defaults.

    Raises:
        TransferError: if too few samples are usable, a point changes its place on the shape, times
            do not increase, nothing moves, or the motion turns back on itself.
    """
    config = config or ReferenceConfig()
    times = frozen_array(times, name="times", shape=("T",))
    positions = frozen_array(positions, name="positions", shape=(len(times), "N", 3), finite=False)
    if np.any(np.diff(times) <= 0.0):
        raise TransferError(
            "The times of the tracked positions do not increase: the smallest step is "
            f"{np.diff(times).min()} s.",
            remedy="Pass each sample once, in order of time.",
        )
    body, X, usable = fit_rigid_motion(positions, config.inlier_distance)
    times = times[usable]
    fine = np.arange(times[0], times[-1], 0.5 * config.sample_period)
    fine = np.append(fine[fine < times[-1] - 1e-9], times[-1])
    X_smooth, V = smooth_poses(times, X, fine, config.smoothing_time)
    arms = body @ np.swapaxes(X_smooth[:, :3, :3], -1, -2)
    speeds = rms_length(V[:, None, 3:] + np.cross(V[:, None, :3], arms))
    stretches = split_motion(fine, speeds, transform_points(X_smooth, body), config)
    X_path = _anchored(fine, X_smooth, stretches, times, X, config)
    path_speeds = np.concatenate([speeds[s] for s in stretches])
    path_times = np.concatenate([fine[s] for s in stretches])
    for _ in range(_MAX_ROUNDS + 1):
        reference = _resample(X_path, path_speeds, body, config)
        back = sharp_turns(reference.positions)
        if back.size == 0:
            return reference
        X_path, path_speeds, path_times = _rounded(X_path, path_speeds, path_times, body)
    where = reference.positions[back[0]].mean(axis=0)
    passed = np.linalg.norm(transform_points(X_path, body).mean(axis=1) - where, axis=1).argmin()
    raise TransferError(
        f"The demonstrated motion turns back on itself {path_times[passed] - times[0]:.1f} s after "
        f"it begins, at ({', '.join(f'{x:.2f}' for x in where)}) m.",
        remedy="Demonstrate a motion that does not return along its own path: the controller "
        "always moves on from the nearest configuration, so it cannot tell the two ways apart.",
    )


def reference_from_samples(
    times: np.ndarray, positions: np.ndarray, config: ReferenceConfig | None = None
) -> PointTrajectory:
    """Returns the reference through points that were recorded without noise.

    The pauses before and after the motion are cut off. Velocities are central differences, and zero
    at the end. Nothing is smoothed and no rigid shape is fitted, so the reference deforms as the
    object did. For tracked points of a rigid object use `make_reference`.

    Args:
        times: (T,) sample times [s], increasing.
        positions: (T, N, 3) positions [m, world], all finite.
        config: What counts as a pause, and the sample period.

    Raises:
        InvalidValueError: if a position is not finite.
        TransferError: if nothing moves.
    """
    config = config or ReferenceConfig()
    times = frozen_array(times, name="times", shape=("T",))
    positions = frozen_array(positions, name="positions", shape=(times.size, "N", 3))
    speeds = rms_length(np.gradient(positions, times, axis=0))
    stretches = split_motion(times, speeds, positions, config)
    kept = slice(max(stretches[0].start - 1, 0), stretches[-1].stop + 1)
    old_times = times[kept] - times[kept.start]
    # The object ends where it came to rest.
    shapes = np.concatenate([positions[kept][:-1], positions[-1:]])
    count = max(round(old_times[-1] / config.sample_period), 1)
    new_times = np.linspace(0.0, old_times[-1], count + 1)
    recorded = PointTrajectory(old_times, shapes, np.zeros_like(shapes))
    resampled = np.array([recorded.positions_at(time) for time in new_times])
    velocities = np.gradient(resampled, new_times, axis=0)
    velocities[-1] = 0.0
    return PointTrajectory(new_times, resampled, velocities)


def sharp_turns(positions: np.ndarray) -> np.ndarray:
    """Returns the samples at which a path (T, N, 3) turns by more than 60 degrees in 3N dimensions.

    Below 90 degrees the velocity x*' at a sample x* points along the segments before and after it.
    Then the field vanishes at no configuration x of the reference's shape before the goal. It
    would need x - x* = x*' / eta, but x - x* points neither along the segment after the closest
    configuration x* nor against the one before. 60 degrees leave a margin for control steps.
    """
    steps = np.diff(positions.reshape(len(positions), -1), axis=0)
    steps = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    return np.flatnonzero(np.vecdot(steps[1:], steps[:-1]) < 0.5) + 1


def _rounded(
    X: np.ndarray, speeds: np.ndarray, times: np.ndarray, body: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns a path smoothed along its length, which shrinks hooks and rounds corners.

    Args:
        X: (T, 4, 4) poses on the path.
        speeds: (T,) speeds at the poses [m/s].
        times: (T,) when the poses were demonstrated [s].
        body: (N, 3) the shape [m].

    Returns:
        Poses X (M, 4, 4), evenly spaced along the smoothed path, with their speeds (M,) and times
        (M,).
    """
    points = transform_points(X, body)
    lengths = np.concatenate([[0.0], np.cumsum(rms_length(np.diff(points, axis=0)))])
    even = np.linspace(0.0, lengths[-1], max(int(lengths[-1] / _ROUNDING_STEP), 2))
    X = interpolate_poses(lengths, X, even)
    points = transform_points(X, body)
    # A reflection about the ends keeps them where they are.
    reach = min(4 * _ROUNDING, len(even) - 1)
    padded = np.pad(points, ((reach, reach), (0, 0), (0, 0)), "reflect", reflect_type="odd")
    smooth = gaussian_filter1d(padded, _ROUNDING, axis=0)[reach:-reach]
    X = kabsch(np.broadcast_to(body, smooth.shape), smooth)
    return X, np.interp(even, lengths, speeds), np.interp(even, lengths, times)


def _anchored(
    fine: np.ndarray,
    X_smooth: np.ndarray,
    stretches: list[slice],
    times: np.ndarray,
    X: np.ndarray,
    config: ReferenceConfig,
) -> np.ndarray:
    """Returns the poses of all stretches, each blended into the rest poses before and after it.

    `fine` has the times of the smoothed poses, `times` those of the fitted poses `X`.
    """
    begins = [-np.inf] + [fine[s.stop - 1] for s in stretches]
    ends = [fine[s.start] for s in stretches] + [np.inf]
    rests = [_rest_pose(times, X, b, e, config) for b, e in zip(begins, ends, strict=True)]
    parts = []
    for k, stretch in enumerate(stretches):
        part = X_smooth[stretch]
        t = fine[stretch] - fine[stretch.start]
        blend = max(min(config.blend_time, 0.5 * t[-1]), 1e-9)
        for rest, end, remaining in ((rests[k], 0, t), (rests[k + 1], -1, t[-1] - t)):
            if rest is None:
                continue
            u = np.clip(1.0 - remaining / blend, 0.0, 1.0)
            share = (u * u * (3.0 - 2.0 * u))[:, None]
            turn = rotation_log(rest[:3, :3] @ part[end, :3, :3].T)
            part = make_transform(
                rotation_exp(share * turn) @ part[:, :3, :3],
                part[:, :3, 3] + share * (rest[:3, 3] - part[end, :3, 3]),
            )
        parts.append(part)
    return np.concatenate(parts)


def _rest_pose(
    times: np.ndarray, X: np.ndarray, begin: float, end: float, config: ReferenceConfig
) -> np.ndarray | None:
    """Returns the mean pose of the settled samples in a pause; None if the pause has no samples."""
    inside = np.flatnonzero((times >= begin) & (times <= end))
    if inside.size == 0:
        return None
    if np.isfinite(begin):
        length = times[inside[-1]] - times[inside[0]]
        settled = times[inside] >= times[inside[0]] + min(config.settle_time, 0.5 * length)
        inside = inside[settled]
    first = X[inside[0], :3, :3]
    turns = rotation_log(X[inside, :3, :3] @ first.T)
    return make_transform(rotation_exp(turns.mean(axis=0)) @ first, X[inside, :3, 3].mean(axis=0))


def _resample(
    X: np.ndarray, speeds: np.ndarray, body: np.ndarray, config: ReferenceConfig
) -> PointTrajectory:
    """Returns the trajectory along poses at given speeds, sampled evenly in time."""
    lengths = rms_length(np.diff(transform_points(X, body), axis=0))
    # Without coincident poses the length along the path determines the pose.
    kept = np.concatenate([[True], lengths > 1e-9])
    path_lengths = np.concatenate([[0.0], np.cumsum(lengths)])[kept]
    X, speeds = X[kept], speeds[kept]
    even = np.linspace(0.0, path_lengths[-1], 4 * len(path_lengths))
    passed = retime(even, np.interp(even, path_lengths, speeds), config.retiming)
    count = max(2, int(np.ceil(passed[-1] / config.sample_period)))
    times = config.sample_period * np.arange(count + 1)
    # Stretched by less than a sample, so that the last sample is the path's end.
    lengths_at = np.interp(times * (passed[-1] / times[-1]), passed, even)
    X = interpolate_poses(path_lengths, X, lengths_at)
    positions = transform_points(X, body)
    velocities = rigid_velocities(X, X[:, :3, 3], positions, config.sample_period)
    return PointTrajectory(times, positions, velocities)
