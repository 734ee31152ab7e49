"""Blind replay: the rival that looks once and then follows its plan."""

import numpy as np

from poil_drake.benchmarks.control.policy import CommandedTwist, Observation
from poil_drake.benchmarks.control.scripted import pose_difference
from poil_drake.diagrams.demonstration_motion import minimum_jerk
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp


class OpenLoopPolicy:
    """Takes the object straight to the demonstration's start, then repeats its motion.

    As in correspondence-based transfer, the points are observed once, at the beginning; from then
    on velocities are commanded without a look at where they lead.
    """

    def __init__(
        self,
        points: np.ndarray,
        *,
        period: float,
        approach_speeds: tuple[float, float] = (1.0, 0.15),
    ):
        """Keeps the demonstration.

        Args:
            points: (T, N, 3) the demonstrated points, one sample each `period` [m, world].
            period: [s].
            approach_speeds: Mean speeds of the way to the start [rad/s, m/s].
        """
        self.period = period
        self._speeds = approach_speeds
        self._first = points[0]
        center = points[0].mean(axis=0)
        # Poses of a frame at the points' centre.
        self._X_PC = make_transform(np.eye(3), center)
        shape = np.broadcast_to(points[0], points.shape)
        self._poses = kabsch(shape, points) @ self._X_PC

    def start(self) -> None:
        """Returns None: there is no plan before the first observation."""

    def step(
        self, state: np.ndarray | None, observation: Observation
    ) -> tuple[np.ndarray, CommandedTwist]:
        """Returns the planned poses (K, 4, 4), and the motion to the next one."""
        poses = self._plan(observation.points) if state is None else state
        k = min(round(observation.time / self.period), len(poses) - 1)
        now, then = poses[k], poses[min(k + 1, len(poses) - 1)]
        return poses, CommandedTwist(pose_difference(now, then) / self.period, now[:3, 3])

    def _plan(self, points: np.ndarray) -> np.ndarray:
        here = kabsch(self._first, points) @ self._X_PC
        difference = pose_difference(here, self._poses[0])
        turn, shift = difference[:3], difference[3:]
        fastest, quickest = self._speeds
        duration = max(np.linalg.norm(turn) / fastest, np.linalg.norm(shift) / quickest)
        count = max(int(np.ceil(duration / self.period)), 1)
        share = minimum_jerk(np.arange(count) / count)[:, None]
        approach = make_transform(
            rotation_exp(share * turn) @ here[:3, :3], here[:3, 3] + share * shift
        )
        return np.concatenate([approach, self._poses])
