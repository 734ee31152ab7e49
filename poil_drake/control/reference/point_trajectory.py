"""Trajectories of point sets, the references of the controller, and the closest configuration."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields
from poil_drake.geometry.rigid_transform import rotation_log

_TIE = 1e-14
"""Each sample's cost is lowered by this fraction of the reference's squared distance from the
world's origin, times the number of earlier samples. The last of equal samples wins, since this
exceeds rounding errors."""


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
    def _cost_terms(self) -> np.ndarray:
        """(4 N, T) each sample's 3 N negative coordinates [m] and N halved squared norms [m^2].

        The norms include the slope of `_TIE`.
        """
        squares = np.vecdot(self.positions, self.positions)
        halves = 0.5 * squares - _TIE * squares.max() * np.arange(len(squares))[:, None]
        terms = np.concatenate([-self.positions.reshape(len(halves), -1), halves], axis=1)
        return terms.T.copy()

    @cached_property
    def _steps(self) -> np.ndarray:
        """(T, 2, 3 N) steps from each sample to the next and the previous [m]; 0 if none exists."""
        forward = np.diff(self.positions.reshape(self.times.size, -1), axis=0)
        padded = np.pad(forward, ((1, 1), (0, 0)))
        return np.stack([padded[1:], -padded[:-1]], axis=1)

    @cached_property
    def _squared_steps(self) -> np.ndarray:
        """(T, 2, N) squared lengths of the points' `_steps` [m^2]."""
        steps = self._steps.reshape(self.times.size, 2, -1, 3)
        return np.vecdot(steps, steps)

    @cached_property
    def _states(self) -> np.ndarray:
        """(T, 2, N, 3) each sample's positions and velocities."""
        return np.stack([self.positions, self.velocities], axis=1)

    @cached_property
    def _changes(self) -> tuple[np.ndarray, np.ndarray]:
        """The changes of time (T,) and `_states` from each sample to the next; 0 at the last."""
        times, states = self.times, self._states
        return np.diff(times, append=times[-1]), np.diff(states, axis=0, append=states[-1:])

    def at_sample(self, sample: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns time (...) [s], positions [m] and velocities [m/s] (..., N, 3) at a sample index.

        Args:
            sample: (...) index; 2.5 is halfway between samples 2 and 3, by linear interpolation.
        """
        before = sample.astype(np.intp)
        fraction = sample - before
        time_changes, state_changes = self._changes
        time = self.times[before] + fraction * time_changes[before]
        change = fraction[..., None, None, None] * state_changes[before]
        state = self._states[before] + change
        return time, state[..., 0, :, :], state[..., 1, :, :]

    def positions_at(self, time: float) -> np.ndarray:
        """Returns the positions (N, 3) [m, world] at a time [s], linear between samples.

        Times outside the trajectory are clamped to it.
        """
        after = min(max(int(self.times.searchsorted(time)), 1), self.times.size - 1)
        start, end = self.times[after - 1 : after + 1].tolist()
        s = min(max((time - start) / (end - start), 0.0), 1.0)
        return (1.0 - s) * self.positions[after - 1] + s * self.positions[after]


def closest_configuration(
    points: np.ndarray,
    reference: PointTrajectory,
    shares: np.ndarray,
    *,
    interpolate: bool,
    window: tuple[float, float] | None = None,
    escape_ratio: float = 0.0,
    previous_tau: np.ndarray | float | None = None,
) -> np.ndarray:
    """Returns the index (...) of the closest configuration; 2.5 is between samples 2 and 3.

    If several samples are equally close, the last one is chosen, so that pauses are skipped.

    Args:
        points: (..., N, 3) [m], finite.
        reference: The reference of the same N points.
        shares: (..., N) weights, which add up to 1; points of weight zero are ignored.
        interpolate: Whether to search between samples, too.
        window: Search range (backward, forward) around the last tick's closest configuration [s];
            None searches the whole reference.
        escape_ratio: The window is ignored if the smallest squared distance of all samples is below
            this fraction of the smallest in the window.
        previous_tau: (...) time of the last tick's closest configuration [s]; NaN for no window.
    """
    # |x - x*|^2 / 2 without |x|^2 / 2, which is the same for all samples.
    weighted = _flat(shares[..., None] * points)
    costs = np.concatenate([weighted, shares], axis=-1) @ reference._cost_terms
    index = costs.argmin(axis=-1)
    if window is not None and previous_tau is not None:
        outside = _outside(reference.times, np.asarray(previous_tau), window)
        nearby = np.where(outside, np.inf, costs).argmin(axis=-1)
        anywhere_square, nearby_square = (
            np.vecdot(shares, np.square(reference.positions[i] - points).sum(axis=-1))
            for i in (index, nearby)
        )
        index = np.where(anywhere_square < escape_ratio * nearby_square, index, nearby)
    if not interpolate:
        return index.astype(float)
    # The closest configurations on the two segments beside the closest sample.
    steps = reference._steps[index]
    offset = _flat(shares[..., None] * (points - reference.positions[index]))
    along = np.vecdot(steps, offset[..., None, :])
    length = np.vecdot(reference._squared_steps[index], shares[..., None, :])
    fraction = np.minimum(np.maximum(along / np.maximum(length, 1e-300), 0.0), 1.0)
    gain = fraction * (2.0 * along - fraction * length)
    forward = gain[..., 0] >= gain[..., 1]
    return index + forward * fraction[..., 0] - ~forward * fraction[..., 1]


def rms_length(vectors: np.ndarray) -> np.ndarray:
    """Returns the root mean square length (...) of the vectors (..., N, 3) of N points."""
    return np.sqrt(np.mean(np.sum(vectors**2, axis=-1), axis=-1))


def rigid_velocities(
    X: np.ndarray, origins: np.ndarray, positions: np.ndarray, period: float
) -> np.ndarray:
    """Returns the velocities (K, N, 3) [m/s] of a rigid body's points, from differences of poses.

    Each sample's velocities are those of a rigid motion: the central difference of the poses, at
    the first sample the forward difference, and at the last sample zero.

    Args:
        X: (K, 4, 4) poses of the body; only the rotations are used.
        origins: (K, 3) positions of a point of the body [m], about which it turns.
        positions: (K, N, 3) positions of the body's points [m].
        period: Time between the samples [s].
    """
    after = np.arange(1, len(X))
    before = np.maximum(after - 2, 0)
    spans = period * (after - before)[:, None]
    turns = X[after, :3, :3] @ X[before, :3, :3].swapaxes(-1, -2)
    omega = rotation_log(turns) / spans
    v = (origins[after] - origins[before]) / spans
    velocities = np.zeros_like(positions)
    arms = positions[:-1] - origins[:-1, None]
    velocities[:-1] = v[:, None] + np.cross(omega[:, None], arms)
    return velocities


def _flat(vectors: np.ndarray) -> np.ndarray:
    return vectors.reshape((*vectors.shape[:-2], 3 * vectors.shape[-2]))


def _outside(
    times: np.ndarray, previous_tau: np.ndarray, window: tuple[float, float]
) -> np.ndarray:
    """Returns which samples are outside of the progress window: (..., T) bool.

    Even the narrowest window contains the samples on both sides of `previous_tau`.
    """
    backward, forward = window
    tau = previous_tau[..., None]
    after = np.arange(times.size) - np.maximum(np.searchsorted(times, tau, side="right") - 1, 0)
    return ((times < tau - backward) | (times > tau + forward)) & (after != 0) & (after != 1)
