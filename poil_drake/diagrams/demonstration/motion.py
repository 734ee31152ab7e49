"""How the object moves in a simulated demonstration: smoothly through keyframes."""

from collections.abc import Sequence

import numpy as np

from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, rotation_log


class KeyframeMotion:
    """A smooth rigid motion through keyframes.

    From each keyframe to the next leads a movement of minimum jerk, as a human arm makes it; each
    begins a little before the one before it has ended, and they add up (Flash and Henis, Journal of
    Cognitive Neuroscience 3, 1991). So the motion is twice continuously differentiable, starts and
    ends at rest, never overshoots, and rounds the corners. Rotations are chained in the same way,
    each about its own fixed axis. Two keyframes of the same pose make a rest between them.

    Args:
        times: (K,) times of the keyframes [s], increasing from 0, K >= 2.
        poses: (K, 4, 4) poses of the object in the world [m].
        blend: How much earlier a movement begins, and how much later it ends, than the keyframes
            say [s]; 0 stops at each keyframe. The first and last times are kept.

    Raises:
        ScenarioError: if the times do not increase from 0.
    """

    def __init__(self, times: Sequence[float] | np.ndarray, poses: np.ndarray, *, blend: float):
        times_ = np.asarray(times, dtype=float)
        if times_.size < 2 or times_[0] != 0.0 or np.any(np.diff(times_) <= 0.0):
            raise ScenarioError(
                f"The demonstration's keyframes are at {times_.tolist()} s.",
                remedy="Give at least two keyframes at increasing times, the first at 0.",
            )
        if blend < 0.0:
            raise ScenarioError(
                f"The demonstration's blend is {blend} s.", remedy="It must not be negative."
            )
        self._first = np.array(poses[0], dtype=float)
        self._duration = float(times_[-1])
        self._starts = np.maximum(times_[:-1] - blend, 0.0)
        self._ends = np.minimum(times_[1:] + blend, self._duration)
        rotations, positions = poses[:, :3, :3], poses[:, :3, 3]
        self._steps = np.diff(positions, axis=0)
        self._turns = rotation_log(np.swapaxes(rotations[:-1], -1, -2) @ rotations[1:])

    @property
    def duration(self) -> float:
        """The time of the last keyframe [s]."""
        return self._duration

    def pose(self, time: float) -> np.ndarray:
        """Returns the (4, 4) pose of the object in the world [m] at a time [s]."""
        share = minimum_jerk((time - self._starts) / (self._ends - self._starts))
        rotation = self._first[:3, :3]
        for turn in rotation_exp(share[:, None] * self._turns):
            rotation = rotation @ turn
        return make_transform(rotation, self._first[:3, 3] + share @ self._steps)


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Returns how much of a movement of least jerk is done after a share of its time.

    s(x) = 10 x^3 - 15 x^4 + 6 x^5, 0 before and 1 after.
    """
    x = np.clip(share, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
