"""Trajectories of point sets: the references that the controller follows."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from poil_drake.control.field.sample_features import SampleFeatures
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields


@dataclass(frozen=True, eq=False)
class PointTrajectory(SharedOnCopy):
    """The motion of N points over T samples.

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
        freeze_fields(self, times=("T",), positions=("T", "N", 3), velocities=("T", "N", 3))
        if len(self.times) < 2 or self.times[0] != 0.0 or np.any(np.diff(self.times) <= 0.0):
            raise InvalidValueError(
                f"PointTrajectory.times has {len(self.times)} samples that do not increase from 0.",
                remedy="Pass at least two strictly increasing times, the first of them 0.",
            )
        if np.any(self.velocities[-1] != 0.0):
            raise InvalidValueError(
                "The last sample of PointTrajectory.velocities is not zero.",
                remedy="Set velocities[-1] = 0: the reference must end at rest.",
            )

    def __getstate__(self) -> dict[str, Any]:
        # Cached properties are recomputed in other processes.
        return {name: getattr(self, name) for name in ("times", "positions", "velocities")}

    @cached_property
    def features(self) -> SampleFeatures:
        """Precomputed terms of the squared distances to all samples."""
        return SampleFeatures.of(self.positions)

    @cached_property
    def states(self) -> np.ndarray:
        """(T, 3, N, 3) each sample's positions, the end's positions, and each sample's velocities.

        In one array they are interpolated in one step, and so are the errors of both positions.
        """
        ends = np.broadcast_to(self.positions[-1], self.positions.shape)
        states = np.stack([self.positions, ends, self.velocities], axis=1)
        states.flags.writeable = False
        return states

    def positions_at(self, time: float) -> np.ndarray:
        """Returns the positions (N, 3) [m, world] at a time [s], linear between samples.

        Times outside the trajectory are clamped to it.
        """
        after = min(max(int(self.times.searchsorted(time)), 1), self.times.size - 1)
        start, end = self.times[after - 1 : after + 1].tolist()
        s = min(max((time - start) / (end - start), 0.0), 1.0)
        return (1.0 - s) * self.positions[after - 1] + s * self.positions[after]

    @cached_property
    def state_steps(self) -> np.ndarray:
        """(T - 1, 3, N, 3) differences of successive `states`."""
        steps = np.diff(self.states, axis=0)
        steps.flags.writeable = False
        return steps
