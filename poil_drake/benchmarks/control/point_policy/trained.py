"""A trained network, and the normalization of its inputs and outputs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.network import Weights, forward

_SMALLEST_HALF_RANGE = 1e-3
"""Lower bound of half the size of the box of `Normalization` [m]. Without it, noise would be
magnified along an axis on which the data hardly vary."""


@dataclass(frozen=True, eq=False)
class Normalization:
    """The bounding box of the data, which is mapped to the cube from -1 to 1.

    Past and future positions are absolute and share one box: the smallest and largest coordinates
    of all points in all demonstrations, as in the paper. The paper's cube goes from 0 to 1.

    Attributes:
        lower: (3,) smallest coordinates in the data [m, world].
        upper: (3,) largest coordinates in the data [m, world].
    """

    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, demonstrations: Sequence[np.ndarray]) -> Self:
        """Returns the bounding box of demonstrations (T_i, N, 3)."""
        positions = np.concatenate(demonstrations)
        return cls(positions.min(axis=(0, 1)), positions.max(axis=(0, 1)))

    def numbers(self, positions: np.ndarray) -> np.ndarray:
        """Returns normalized values (..., N, 3 L), float32, of L samples (..., L, N, 3) [m]."""
        numbers = (positions - self._center()) / self._half_range()
        per_point = np.swapaxes(numbers, -3, -2)
        return per_point.reshape(*per_point.shape[:-2], -1).astype(np.float32)

    def positions(self, numbers: np.ndarray) -> np.ndarray:
        """Returns the L samples (L, N, 3) [m, world] of normalized values (N, 3 L)."""
        in_cube = numbers.reshape(len(numbers), -1, 3).swapaxes(0, 1)
        return self._center() + self._half_range() * in_cube

    def _center(self) -> np.ndarray:
        return 0.5 * (self.lower + self.upper)

    def _half_range(self) -> np.ndarray:
        return np.maximum(0.5 * (self.upper - self.lower), _SMALLEST_HALF_RANGE)


@dataclass(frozen=True, eq=False)
class TrainedPointPolicy:
    """Predicts the motion of points.

    Attributes:
        config: Settings of the network and its training.
        normalization: Bounding box of the demonstrations.
        weights: Weights of `network.forward`, float32.
    """

    config: PointPolicyConfig
    normalization: Normalization
    weights: Weights

    def predict(self, history: np.ndarray) -> np.ndarray:
        """Returns the next positions (K, N, 3) after a history (H, N, 3), oldest first [m, world].

        H and N must be the same as in training.
        """
        outputs = forward(self.weights, self.normalization.numbers(history), self.config)
        return self.normalization.positions(outputs)
