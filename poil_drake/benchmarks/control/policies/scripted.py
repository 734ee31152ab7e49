"""Policies with a planned motion: for demonstrations, and for open-loop replay."""

from typing import NamedTuple

import numpy as np

from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation, Policy
from poil_drake.diagrams.demonstration.motion import minimum_jerk
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp, rotation_log

_GAIN = 5.0
"""Gain of the correction of pose errors [1/s]."""

_PEAK = 1.875
"""Peak over mean speed of a minimum-jerk motion."""


class ScriptedPolicy(Policy):
    """Moves the object along known poses in closed loop, as a human demonstrator does.

    Args:
        poses: (T, 4, 4) poses of the object's driven body, one per `period`; the last one is held.
        period: Time between two steps [s].
    """

    def __init__(self, poses: np.ndarray, *, period: float):
        self.period = period
        self._poses = poses

    def step(self, state: None, observation: Observation) -> tuple[None, CommandedTwist]:
        """Returns the motion to the next pose, with feedback on the pose error."""
        k = round(observation.time / self.period)
        return None, _track(self._poses, k, observation.X_WO, self.period)


class ReplayPlan(NamedTuple):
    """The planned motion of the hand.

    Attributes:
        begin: Time at which the motion begins [s].
        poses: (K, 4, 4) poses of the hand, one per period.
    """

    begin: float
    poses: np.ndarray


class OpenLoopPolicy(Policy):
    """Moves the object straight to the demonstration's start, then repeats the demonstration.

    The points are observed once, at the beginning. From then on, the hand tracks planned poses with
    feedback from its own pose only.

    Args:
        points: (T, N, 3) the demonstrated points, one sample per `period` [m, world].
        period: Time between two steps [s].
        max_angular_speed: Upper bound of the hand's angular speed on the way to the start [rad/s].
        max_linear_speed: Upper bound of the hand's linear speed on the way to the start [m/s].
    """

    def __init__(
        self,
        points: np.ndarray,
        *,
        period: float,
        max_angular_speed: float,
        max_linear_speed: float,
    ):
        self.period = period
        # A share of the speed is reserved for the correction of errors on the way.
        self._speeds = 0.8 * max_angular_speed / _PEAK, 0.8 * max_linear_speed / _PEAK
        self._first = points[0]
        self._motion = kabsch(np.broadcast_to(points[0], points.shape), points)

    def step(
        self, state: ReplayPlan | None, observation: Observation
    ) -> tuple[ReplayPlan | None, CommandedTwist]:
        """Returns the plan and the motion to its next pose; None and rest until points are seen."""
        if state is None:
            if not observation.confidence.all():
                return None, CommandedTwist(np.zeros(6), observation.X_WH[:3, 3])
            state = ReplayPlan(observation.time, self._plan(observation))
        k = round((observation.time - state.begin) / self.period)
        return state, _track(state.poses, k, observation.X_WH, self.period)

    def _plan(self, observation: Observation) -> np.ndarray:
        to_start = inverse(kabsch(self._first, observation.points))
        here, there = observation.X_WH, to_start @ observation.X_WH
        turn, shift = np.split(pose_difference(here, there), 2)
        max_angular, max_linear = self._speeds
        duration = max(np.linalg.norm(turn) / max_angular, np.linalg.norm(shift) / max_linear)
        count = max(int(np.ceil(duration / self.period)), 1)
        share = minimum_jerk(np.arange(count) / count)[:, None]
        approach = make_transform(
            rotation_exp(share * turn) @ here[:3, :3], here[:3, 3] + share * shift
        )
        return np.concatenate([approach, self._motion @ there])


def pose_difference(X_from: np.ndarray, X_to: np.ndarray) -> np.ndarray:
    """Returns (6,), the rotation vector [rad] and shift [m] between two poses (4, 4), world."""
    turn = rotation_log(X_to[:3, :3] @ X_from[:3, :3].T)
    return np.concatenate([turn, X_to[:3, 3] - X_from[:3, 3]])


def _track(poses: np.ndarray, k: int, X: np.ndarray, period: float) -> CommandedTwist:
    """Returns the motion from the k-th to the next pose, with feedback on the pose error.

    Args:
        poses: (K, 4, 4) planned poses, one per `period`; the last one is held.
        k: Index of the pose that is planned for the present.
        X: (4, 4) the measured pose.
        period: Time between two poses [s].
    """
    now, then = (poses[min(i, len(poses) - 1)] for i in (k, k + 1))
    V = pose_difference(now, then) / period + _GAIN * pose_difference(X, now)
    return CommandedTwist(V, X[:3, 3])
