"""Timed joint-space motions."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields


@dataclass(frozen=True, eq=False)
class JointTrajectory(SharedOnCopy):
    """A joint motion, linear between samples.

    Attributes:
        times: (T,) sample times [s], strictly increasing from 0, T >= 2.
        positions: (T, J) joint positions [rad].
        velocities: (T, J) joint velocities [rad/s].
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray

    def __post_init__(self) -> None:
        freeze_fields(self, times=("T",), positions=("T", "J"), velocities=("T", "J"))
        times = self.times
        wrong = np.flatnonzero(np.r_[times[:1] != 0.0, np.diff(times) <= 0.0])
        if times.size < 2 or wrong.size:
            found = f"; times[{wrong[0]}] is {times[wrong[0]]} s" if wrong.size else ""
            raise InvalidValueError(
                f"JointTrajectory has {times.size} times, which do not increase from 0{found}.",
                remedy="Pass at least two strictly increasing times, the first of them 0.",
            )

    @property
    def duration(self) -> float:
        """The motion's duration [s]."""
        return float(self.times[-1])

    def slowed(self, speed: float) -> "JointTrajectory":
        """Returns the motion along the same path with all velocities times `speed`, in (0, 1]."""
        return JointTrajectory(self.times / speed, self.positions, speed * self.velocities)

    def sample(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns positions (J,) [rad] and velocities (J,) [rad/s] at `time` [s].

        Before its start and after its end, the motion is at rest.
        """
        if not 0.0 < time < self.times[-1]:
            end = self.positions[0 if time <= 0.0 else -1]
            return end, np.zeros(end.size)
        after = int(np.searchsorted(self.times, time, side="right"))
        ratio = (time - self.times[after - 1]) / (self.times[after] - self.times[after - 1])
        blend = np.array([1.0 - ratio, ratio])
        return (
            blend @ self.positions[after - 1 : after + 1],
            blend @ self.velocities[after - 1 : after + 1],
        )
