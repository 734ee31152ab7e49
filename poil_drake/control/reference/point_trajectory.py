"""The reference that the controller follows."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from poil_drake.control.field.sample_features import SampleFeatures
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array


@dataclass(frozen=True, eq=False)
class PointTrajectory(SharedOnCopy):
    """N points over T samples.

    Attributes:
        times: (T,) sample times [s], strictly increasing from 0, T >= 2.
        positions: (T, N, 3) positions [m, world].
        velocities: (T, N, 3) velocities [m/s, world]; the last sample's are zero, because the
            terminal analysis of POIL (section III-B) needs the field to be pure contraction there.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray

    def __post_init__(self) -> None:
        times = frozen_array(self.times, name="PointTrajectory.times", shape=("T",))
        if times.size < 2 or times[0] != 0.0 or np.any(np.diff(times) <= 0.0):
            raise InvalidValueError(
                f"PointTrajectory.times has {times.size} samples that do not increase from 0.",
                remedy="Pass at least two strictly increasing times, the first of them 0.",
            )
        T = times.size
        positions = frozen_array(
            self.positions, name="PointTrajectory.positions", shape=(T, "N", 3)
        )
        velocities = frozen_array(
            self.velocities, name="PointTrajectory.velocities", shape=positions.shape
        )
        if np.any(velocities[-1] != 0.0):
            raise InvalidValueError(
                "The last sample of PointTrajectory.velocities is not zero.",
                remedy="Set velocities[-1] = 0: the reference must end at rest.",
            )
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "velocities", velocities)

    def __getstate__(self) -> dict[str, Any]:
        # What can be worked out again does not travel to other processes.
        return {name: getattr(self, name) for name in ("times", "positions", "velocities")}

    @cached_property
    def features(self) -> SampleFeatures:
        """What squared distances from all samples are made of."""
        return SampleFeatures.of(self.positions)

    @cached_property
    def states(self) -> np.ndarray:
        """(T, 3, N, 3) each sample's positions, those of the end, and velocities.

        Side by side they are interpolated, and compared with the points, in one step each.
        """
        ends = np.broadcast_to(self.positions[-1], self.positions.shape)
        states = np.stack([self.positions, ends, self.velocities], axis=1)
        states.flags.writeable = False
        return states

    def positions_at(self, time: float) -> np.ndarray:
        """Returns the points (N, 3) [m, world] at a time [s], linear between samples.

        Before the start and after the end they are those there.
        """
        after = min(max(int(self.times.searchsorted(time)), 1), self.times.size - 1)
        start, end = self.times[after - 1 : after + 1].tolist()
        s = min(max((time - start) / (end - start), 0.0), 1.0)
        return (1.0 - s) * self.positions[after - 1] + s * self.positions[after]

    @cached_property
    def state_steps(self) -> np.ndarray:
        """(T - 1, 3, N, 3) from each of `states` to the next."""
        steps = np.diff(self.states, axis=0)
        steps.flags.writeable = False
        return steps
