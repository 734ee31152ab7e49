"""Point Policy as a controller of the study."""

from typing import NamedTuple

import numpy as np

from poil_drake.benchmarks.control.point_policy.network import TrainedPointPolicy
from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation, Policy
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import rotation_log, transform_points


class PointPolicyState(NamedTuple):
    """The policy's memory.

    Attributes:
        history: The latest observations (N, 3) [m, world], oldest first; empty at the start.
        chunks: The latest predictions (K, N, 3) [m, world], oldest first; the last one was made
            in the latest step.
    """

    history: tuple[np.ndarray, ...] = ()
    chunks: tuple[np.ndarray, ...] = ()


class PointPolicy(Policy):
    """Moves the points to their predicted next positions, averaged over the latest predictions.

    Every observation must contain every point.

    Args:
        trained: The network that predicts.
    """

    def __init__(self, trained: TrainedPointPolicy):
        self._trained = trained
        self.period = trained.config.period

    def start(self) -> PointPolicyState:
        """Returns a state without history and predictions."""
        return PointPolicyState()

    def step(
        self, state: PointPolicyState, observation: Observation
    ) -> tuple[PointPolicyState, CommandedTwist]:
        """Returns the next state and the twist that reaches the predicted points in one period."""
        config, points = self._trained.config, observation.points.copy()
        history = (state.history or (points,) * (config.history - 1))[1 - config.history :]
        history = (*history, points)
        chunk = self._trained.predict(np.stack(history))
        chunks = (*state.chunks, chunk)[-config.chunk :]
        target = aggregate_chunks(chunks, config.aggregation_rate)
        return PointPolicyState(history, chunks), twist_between(points, target, self.period)


def aggregate_chunks(chunks: tuple[np.ndarray, ...], rate: float) -> np.ndarray:
    """Returns the next positions (N, 3) [m, world], averaged over the chunks that predict them.

    The weights are exp(-m i), where i = 0 is the oldest chunk (Zhao et al., RSS 2023).

    Args:
        chunks: Predictions (K, N, 3) [m, world], one of each of the latest steps, oldest first.
        rate: m in the weights.
    """
    predictions = np.stack([chunk[age] for age, chunk in enumerate(reversed(chunks))][::-1])
    weights = np.exp(-rate * np.arange(len(chunks)))
    return np.tensordot(weights / weights.sum(), predictions, axes=1)


def twist_between(points: np.ndarray, target: np.ndarray, period: float) -> CommandedTwist:
    """Returns the constant twist that best moves points (N, 3) to a target (N, 3) in a period [s].

    The commanded point is the centroid of the points, which moves along a straight line.
    """
    X = kabsch(points, target)
    centroid = points.mean(axis=0)
    v = (transform_points(X, centroid) - centroid) / period
    return CommandedTwist(np.concatenate([rotation_log(X[:3, :3]) / period, v]), centroid)
