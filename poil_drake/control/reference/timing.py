"""The timing of references: which parts of a demonstration they follow, and how fast."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.control.reference.point_trajectory import rms_length
from poil_drake.errors import InvalidValueError, TransferError


@dataclass(frozen=True, kw_only=True)
class RetimingConfig:
    """Speed limits of a reference. Speeds are root mean square over the points.

    Attributes:
        speed_scale: Factor on the demonstrated speed.
        min_speed: Lowest speed before the final deceleration [m/s]. The closest configuration
            advances only where the reference does.
        max_speed: Highest speed [m/s]; 0.25 is the limit for a collaborative robot near people.
        acceleration_time: Time to reach the mean speed from rest, and to stop at the end [s].
    """

    speed_scale: float = 1.0
    min_speed: float = 0.02
    max_speed: float = 0.25
    acceleration_time: float = 0.5

    def __post_init__(self) -> None:
        positive = min(self.speed_scale, self.min_speed, self.acceleration_time) > 0.0
        if not (positive and self.min_speed <= self.max_speed):
            raise InvalidValueError(
                f"{self} has a value that is not positive, or min_speed exceeds max_speed.",
                remedy="Pass positive values, with min_speed at most max_speed.",
            )


@dataclass(frozen=True, kw_only=True)
class ReferenceConfig:
    """How tracked points become a reference.

    Attributes:
        sample_period: Time between the reference's samples [s]. 1/32 s is about 3 mm at 0.1 m/s.
        smoothing_time: Bandwidth of the smoothing [s]; motion shorter than twice this is smoothed
            away. 0.25 s spans about five samples of a tracker at 8 Hz.
        dwell_speed: Slower samples are at rest [m/s, root mean square over the points]. Noise of
            1 mm at 8 Hz is about 0.003 m/s after smoothing.
        min_pause: Shorter pauses are not cut out [s]; the reference passes them at the lowest speed
            of `retiming`.
        min_displacement: A stretch of motion in which the points stay within this distance of
            where it began is noise [m, root mean square over the points].
        settle_time: Samples within this time after the motion stops are left out of the mean pose
            at rest [s], but at most the first half of the pause.
        blend_time: Time before and after a pause in which the smoothed motion is blended into the
            pose at rest [s].
        inlier_distance: Largest distance of an inlier from its place on the rigid shape [m]. Wider
            than for control, because trackers of demonstrations need not preserve the shape.
        retiming: Speed limits of the reference.
    """

    sample_period: float = 1.0 / 32.0
    smoothing_time: float = 0.25
    dwell_speed: float = 0.01
    min_pause: float = 0.5
    min_displacement: float = 0.01
    settle_time: float = 0.5
    blend_time: float = 0.5
    inlier_distance: float = 0.01
    retiming: RetimingConfig = field(default_factory=RetimingConfig)

    def __post_init__(self) -> None:
        if not (self.sample_period > 0.0 and self.smoothing_time > 0.0):
            raise InvalidValueError(
                f"ReferenceConfig has sample_period={self.sample_period} s and "
                f"smoothing_time={self.smoothing_time} s.",
                remedy="Pass positive times.",
            )


def split_motion(
    times: np.ndarray, speeds: np.ndarray, positions: np.ndarray, config: ReferenceConfig
) -> list[slice]:
    """Returns the stretches of samples in which the points move, in order.

    The other samples are pauses. A reference must not contain them: the field would stop there.

    Args:
        times: (T,) [s].
        speeds: (T,) root mean square speed of the points [m/s].
        positions: (T, N, 3) positions of the points [m].
        config: What counts as a pause, and what as noise.

    Raises:
        TransferError: if nothing moves.
    """
    moving = np.concatenate([[0], (speeds > config.dwell_speed).astype(np.int8), [0]])
    bounds = np.flatnonzero(np.diff(moving)).tolist()
    stretches: list[slice] = []
    for begin, end in zip(bounds[::2], bounds[1::2], strict=True):
        if rms_length(positions[begin:end] - positions[begin]).max() < config.min_displacement:
            continue
        if stretches and times[begin] - times[stretches[-1].stop - 1] < config.min_pause:
            begin = stretches.pop().start
        stretches.append(slice(begin, end))
    if not stretches:
        raise TransferError(
            f"Nothing moves in the demonstration: for {times[-1] - times[0]:.1f} s the points are "
            f"slower than {config.dwell_speed} m/s, or move less than {config.min_displacement} m.",
            remedy="Check that the tracker followed the moving object, or demonstrate a faster or "
            "longer motion.",
        )
    return stretches


def retime(path_lengths: np.ndarray, speeds: np.ndarray, config: RetimingConfig) -> np.ndarray:
    """Returns the times (M,) [s], from 0, at which a motion passes points along a path.

    Args:
        path_lengths: (M,) length of the path up to each point [m], increasing from 0.
        speeds: (M,) demonstrated speeds at these points [m/s].
        config: The limits.
    """
    v = np.clip(config.speed_scale * speeds, config.min_speed, config.max_speed)
    steps = np.diff(path_lengths)
    mean_speed = path_lengths[-1] / np.sum(2.0 * steps / (v[1:] + v[:-1]))
    acceleration = mean_speed / config.acceleration_time
    # v^2 grows by at most 2 a s along the path: forwards from min_speed, backwards from rest.
    squares = v**2
    squares[0], squares[-1] = config.min_speed**2, 0.0
    for k in range(1, len(squares)):
        squares[k] = min(squares[k], squares[k - 1] + 2.0 * acceleration * steps[k - 1])
    for k in range(len(squares) - 2, -1, -1):
        squares[k] = min(squares[k], squares[k + 1] + 2.0 * acceleration * steps[k])
    v = np.sqrt(squares)
    # Exact for constant acceleration over a step, even if it ends at rest.
    return np.concatenate([[0.0], np.cumsum(2.0 * steps / (v[1:] + v[:-1]))])
