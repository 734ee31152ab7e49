"""The object's motion in a simulated demonstration: smooth, through keyframes."""

from collections.abc import Sequence

import numpy as np

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, rotation_log


class KeyframeMotion:
    """A smooth rigid motion through keyframes.

    A minimum-jerk movement, as of a human arm, leads from each keyframe to the next. Each movement
    starts a little before the previous one ends, and their displacements add up (Flash and Henis,
    Journal of Cognitive Neuroscience 3, 1991). So the motion is twice continuously differentiable,
    starts and ends at rest, does not overshoot, and rounds the corners. Rotations are composed in
    the same way, each about its own fixed axis. Two equal consecutive poses hold the object still.

    Args:
        times: (K,) times of the keyframes [s], increasing from 0, K >= 2.
        poses: (K, 4, 4) poses of the object in the world [m].
        blend: How long before its first keyframe each movement starts, and how long after its
            second keyframe it ends [s]. The whole motion still starts at the first keyframe and
            ends at the last. With a blend of 0, the object stops at each keyframe.

    Attributes:
        duration: Time of the last keyframe [s].
    """

    def __init__(self, times: Sequence[float] | np.ndarray, poses: np.ndarray, *, blend: float):
        times = np.asarray(times)
        self._first = np.array(poses[0], dtype=float)
        self.duration = float(times[-1])
        self._starts = np.maximum(times[:-1] - blend, 0.0)
        self._ends = np.minimum(times[1:] + blend, self.duration)
        rotations, positions = poses[:, :3, :3], poses[:, :3, 3]
        self._steps = np.diff(positions, axis=0)
        self._turns = rotation_log(np.swapaxes(rotations[:-1], -1, -2) @ rotations[1:])

    def pose(self, time: float) -> np.ndarray:
        """Returns the (4, 4) pose of the object in the world [m] at a time [s]."""
        share = minimum_jerk((time - self._starts) / (self._ends - self._starts))
        rotation = self._first[:3, :3]
        for turn in rotation_exp(share[:, None] * self._turns):
            rotation = rotation @ turn
        return make_transform(rotation, self._first[:3, 3] + share @ self._steps)


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Returns the completed fraction of a minimum-jerk movement after a `share` of its time.

    s(x) = 10 x^3 - 15 x^4 + 6 x^5, where x is `share` clipped to [0, 1].
    """
    x = np.clip(share, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
