"""Trajectories of point sets: the references that the controller follows."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

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
                f"PointTrajectory.times, with {len(self.times)} samples, is not a sequence of at "
                "least two times that increase from 0.",
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
    def cost_terms(self) -> np.ndarray:
        """(4 N, T) each sample's 3 N negative coordinates [m] and N halved squared norms [m^2]."""
        halves = 0.5 * np.vecdot(self.positions, self.positions)
        terms = np.concatenate([-self.positions.reshape(len(halves), -1), halves], axis=1)
        return _constant(terms.T.copy())

    @cached_property
    def largest_square(self) -> float:
        """Largest squared distance of a point from the world's origin [m^2]."""
        return float(np.vecdot(self.positions, self.positions).max())

    @cached_property
    def steps(self) -> np.ndarray:
        """(T, 2, 3 N) steps from each sample to the next and the previous [m]; 0 if none exists."""
        forward = np.diff(self.positions.reshape(self.times.size, -1), axis=0)
        padded = np.pad(forward, ((1, 1), (0, 0)))
        return _constant(np.stack([padded[1:], -padded[:-1]], axis=1))

    @cached_property
    def squared_steps(self) -> np.ndarray:
        """(T, 2, N) squared lengths of the points' `steps` [m^2]."""
        steps = self.steps.reshape(self.times.size, 2, -1, 3)
        return _constant(np.vecdot(steps, steps))

    @cached_property
    def states(self) -> np.ndarray:
        """(T, 2, N, 3) each sample's positions and velocities."""
        return _constant(np.stack([self.positions, self.velocities], axis=1))

    def at_sample(self, sample: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns time (...) [s], positions [m] and velocities [m/s] (..., N, 3) at a sample index.

        Args:
            sample: (...) index; 2.5 is halfway between samples 2 and 3, by linear interpolation.
        """
        before = sample.astype(np.intp)
        after = np.minimum(before + 1, self.times.size - 1)
        fraction = sample - before
        time, state = self.times[before], self.states[before]
        time = time + fraction * (self.times[after] - time)
        state = state + fraction[..., None, None, None] * (self.states[after] - state)
        return time, state[..., 0, :, :], state[..., 1, :, :]

    def positions_at(self, time: float) -> np.ndarray:
        """Returns the positions (N, 3) [m, world] at a time [s], linear between samples.

        Times outside the trajectory are clamped to it.
        """
        after = min(max(int(self.times.searchsorted(time)), 1), self.times.size - 1)
        start, end = self.times[after - 1 : after + 1].tolist()
        s = min(max((time - start) / (end - start), 0.0), 1.0)
        return (1.0 - s) * self.positions[after - 1] + s * self.positions[after]


def _constant(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False
    return values
