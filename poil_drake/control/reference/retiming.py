"""Retimes a path: the demonstrated speed within limits, and a smooth stop at the end."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError


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
