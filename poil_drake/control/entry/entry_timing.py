"""From a way to the reference to one reference that begins where the object is."""

from dataclasses import dataclass

import numpy as np

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.control.reference.pose_smoothing import interpolate_poses
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import inverse, rotation_log, transform_points


@dataclass(frozen=True, kw_only=True)
class EntryTimingConfig:
    """How fast a transit is followed. Speeds are root mean square over the points.

    Attributes:
        speed: Cruising speed [m/s]; a demonstration's is 0.1 to 0.25.
        angular_speed: Fastest turn [rad/s]; points close to each other say little of it.
        acceleration: Of the points [m/s^2]; 0.3 reaches the cruising speed in half a second.
        crawl: Speed at the start [m/s]. Zero there would be an equilibrium of the field.
        sample_period: Time between samples [s], as references have.
    """

    speed: float = 0.15
    angular_speed: float = 1.0
    acceleration: float = 0.3
    crawl: float = 0.02
    sample_period: float = 1.0 / 32.0

    def __post_init__(self) -> None:
        if not (
            0.0 < self.crawl <= self.speed
            and min(self.angular_speed, self.acceleration, self.sample_period) > 0.0
        ):
            raise InvalidValueError(
                f"{self} cannot be followed.",
                remedy="All numbers must be positive, and crawl not above speed.",
            )


def extended_reference(
    reference: PointTrajectory,
    poses: np.ndarray,
    index: int,
    config: EntryTimingConfig,
) -> PointTrajectory:
    """Returns the reference that goes along a transit and then on from sample `index`.

    The transit carries the reference's own shape at that sample, so that nothing jumps there, and
    arrives with the speed that the reference has there, or the cruising speed if that is less. Its
    velocities are rigid motions and not zero, so the field moves along it everywhere; the end is
    the demonstration's, at rest.

    Args:
        reference: The demonstration.
        poses: (K, 4, 4) poses of the object, in the end that of the sample [m, world].
        index: Sample of the reference.
        config: Speeds.
    """
    shape = reference.positions[index]
    motions = poses @ inverse(poses[-1])
    lengths = _lengths(motions, shape, config)
    kept = np.r_[True, lengths > 1e-9]
    motions, along = motions[kept], np.concatenate([[0.0], np.cumsum(lengths[lengths > 1e-9])])
    last = index == len(reference.times) - 1
    if len(along) < 2:
        if last:
            # A reference has two samples at least, of which the first may not stand still; these
            # do, at the goal.
            index -= 1
        times = reference.times[index:] - reference.times[index]
        return PointTrajectory(times, reference.positions[index:], reference.velocities[index:])
    velocity = reference.velocities[index]
    end_speed = 0.0 if last else float(np.sqrt(np.mean(np.sum(velocity**2, axis=1))))
    even = np.linspace(0.0, along[-1], 4 * len(along))
    passed = _passing_times(even, end_speed, config)
    count = max(2, int(np.ceil(passed[-1] / config.sample_period)))
    times = np.linspace(0.0, passed[-1], count + 1)
    motions = interpolate_poses(along, motions, np.interp(times, passed, even))
    positions = transform_points(motions, shape)
    velocities = _rigid_velocities(motions, positions, times[1])
    positions[-1] = shape
    velocities[-1] = 0.0 if last else velocity
    return PointTrajectory(
        np.concatenate([times, times[-1] + reference.times[index + 1 :] - reference.times[index]]),
        np.concatenate([positions, reference.positions[index + 1 :]]),
        np.concatenate([velocities, reference.velocities[index + 1 :]]),
    )


def _lengths(motions: np.ndarray, shape: np.ndarray, config: EntryTimingConfig) -> np.ndarray:
    """Returns the steps' lengths (K - 1,) [m]: of the points, or of the turn where that is slower.

    A turn by an angle counts as what takes as long at the cruising speed.
    """
    steps = np.diff(transform_points(motions, shape), axis=0)
    moved = np.sqrt(np.mean(np.sum(steps**2, axis=2), axis=1))
    turns = rotation_log(motions[1:, :3, :3] @ motions[:-1, :3, :3].swapaxes(-1, -2))
    turned = np.linalg.norm(turns, axis=1) * config.speed / config.angular_speed
    return np.maximum(moved, turned)


def _passing_times(along: np.ndarray, end_speed: float, config: EntryTimingConfig) -> np.ndarray:
    """Returns the times (M,) [s] at which lengths (M,) [m] are passed, at bounded acceleration.

    v^2 grows by 2 a s: from the crawl at the start, and backwards from the speed at the end.
    """
    growth = 2.0 * config.acceleration
    squares = np.minimum(config.crawl**2 + growth * along, config.speed**2)
    squares = np.minimum(squares, end_speed**2 + growth * (along[-1] - along))
    v = np.sqrt(squares)
    return np.concatenate([[0.0], np.cumsum(2.0 * np.diff(along) / (v[1:] + v[:-1]))])


def _rigid_velocities(X: np.ndarray, positions: np.ndarray, period: float) -> np.ndarray:
    """Returns central differences of a motion as rigid motions (K, N, 3) [m/s]; the last is zero.

    Args:
        X: (K, 4, 4) motions of the world.
        positions: (K, N, 3) where they carry the points.
        period: Time between them [s].
    """
    last = len(X) - 1
    before, after = np.maximum(np.arange(last) - 1, 0), np.arange(last) + 1
    spans = period * (after - before)[:, None]
    centres = positions.mean(axis=1)
    v = (centres[after] - centres[before]) / spans
    turns = X[after, :3, :3] @ X[before, :3, :3].swapaxes(-1, -2)
    omega = rotation_log(turns) / spans
    velocities = np.zeros_like(positions)
    arms = positions[:-1] - centres[:-1, None]
    velocities[:-1] = v[:, None] + np.cross(omega[:, None], arms)
    return velocities
