"""Policies that know their whole motion beforehand: for demonstrations, and for blind replay."""

from typing import Any

import numpy as np

from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation
from poil_drake.geometry.rigid_transform import rotation_log


class ScriptedPolicy:
    """Leads the object along known poses in closed loop, as whoever demonstrates does."""

    def __init__(self, poses: np.ndarray, *, period: float, gain: float = 5.0):
        """Keeps the motion.

        Args:
            poses: (T, 4, 4) of the object's driven body, one each `period`; it stays at the last.
            period: [s].
            gain: Of the correction [1/s].
        """
        self.period = period
        self._poses = poses
        self._gain = gain

    def start(self) -> None:
        """Returns None: where it is follows from the time."""

    def step(self, state: Any, observation: Observation) -> tuple[Any, CommandedTwist]:
        """Returns the motion that reaches the next pose, with the error corrected."""
        k = round(observation.time / self.period)
        return state, track_poses(
            self._poses, k, observation.X_WO, period=self.period, gain=self._gain
        )


def track_poses(
    poses: np.ndarray, k: int, X: np.ndarray, *, period: float, gain: float = 5.0
) -> CommandedTwist:
    """Returns the motion along poses (K, 4, 4) from the k-th to the next, with the error corrected.

    Args:
        poses: One each `period`; the last is kept.
        k: Which of them is now.
        X: (4, 4) the pose as it is.
        period: [s].
        gain: Of the correction [1/s].
    """
    now, then = (poses[min(i, len(poses) - 1)] for i in (k, k + 1))
    V = pose_difference(now, then) / period + gain * pose_difference(X, now)
    return CommandedTwist(V, X[:3, 3])


def pose_difference(X_from: np.ndarray, X_to: np.ndarray) -> np.ndarray:
    """Returns the turn [rad] and shift [m] (6,), world, from one pose (4, 4) to another."""
    turn = rotation_log(X_to[:3, :3] @ X_from[:3, :3].T)
    return np.concatenate([turn, X_to[:3, 3] - X_from[:3, 3]])
