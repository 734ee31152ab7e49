"""Blind replay: the rival that looks once and then follows its plan."""

from typing import NamedTuple

import numpy as np

from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation
from poil_drake.benchmarks.control.policies.scripted import track_poses
from poil_drake.diagrams.demonstration.motion import minimum_jerk
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_exp,
    rotation_log,
)

_PEAK = 1.875
"""Fastest over mean speed of a movement of minimum jerk."""


class ReplayPlan(NamedTuple):
    """Where the hand is going to be.

    Attributes:
        begin: When it begins [s].
        poses: (K, 4, 4) of the hand, one each period.
    """

    begin: float
    poses: np.ndarray


class OpenLoopPolicy:
    """Takes the object straight to the demonstration's start, then repeats its motion.

    As in correspondence-based transfer, the points are observed once, at the beginning. From then
    on the hand is led along the poses that follow, in closed loop on its own pose, as an arm is
    on its joints; what becomes of the object is not looked at.
    """

    def __init__(
        self,
        points: np.ndarray,
        *,
        period: float,
        max_angular_speed: float,
        max_linear_speed: float,
    ):
        """Keeps the demonstration.

        Args:
            points: (T, N, 3) the demonstrated points, one sample each `period` [m, world].
            period: [s].
            max_angular_speed: That of the way to the start stays below [rad/s].
            max_linear_speed: The same of the hand [m/s].
        """
        self.period = period
        # What is corrected on the way needs some speed, too.
        self._speeds = 0.8 * max_angular_speed / _PEAK, 0.8 * max_linear_speed / _PEAK
        self._first = points[0]
        self._motion = kabsch(np.broadcast_to(points[0], points.shape), points)

    def start(self) -> None:
        """Returns None: there is no plan before the points are seen."""

    def step(
        self, state: ReplayPlan | None, observation: Observation
    ) -> tuple[ReplayPlan | None, CommandedTwist]:
        """Returns the plan, and the motion to its next pose."""
        if state is None:
            if not observation.confidence.all():
                return None, CommandedTwist(np.zeros(6), observation.X_WH[:3, 3])
            state = ReplayPlan(observation.time, self._plan(observation))
        k = round((observation.time - state.begin) / self.period)
        return state, track_poses(state.poses, k, observation.X_WH, period=self.period)

    def _plan(self, observation: Observation) -> np.ndarray:
        # How the object would have to move to be where the demonstration started.
        to_start = inverse(kabsch(self._first, observation.points))
        here, there = observation.X_WH, to_start @ observation.X_WH
        turn = rotation_log(there[:3, :3] @ here[:3, :3].T)
        shift = there[:3, 3] - here[:3, 3]
        fastest, quickest = self._speeds
        duration = max(np.linalg.norm(turn) / fastest, np.linalg.norm(shift) / quickest)
        count = max(int(np.ceil(duration / self.period)), 1)
        share = minimum_jerk(np.arange(count) / count)[:, None]
        approach = make_transform(
            rotation_exp(share * turn) @ here[:3, :3], here[:3, 3] + share * shift
        )
        return np.concatenate([approach, self._motion @ there])
