"""A trained network and its normalization, and how they are kept in a file."""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.network import Weights, forward
from poil_drake.benchmarks.control.point_policy.normalization import Normalization
from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class TrainedPointPolicy:
    """Predicts the motion of points.

    Attributes:
        config: How it was trained.
        normalization: Bounding box of the demonstrations.
        weights: Weights of `network.forward`, float32.
    """

    config: PointPolicyConfig
    normalization: Normalization
    weights: Weights

    def predict(self, history: np.ndarray) -> np.ndarray:
        """Returns the next positions (K, N, 3) after a history (H, N, 3), oldest first [m, world].

        H and N are those of the training.
        """
        outputs = forward(self.weights, self.normalization.numbers(history), self.config)
        return self.normalization.positions(outputs)

    def save(self, path: Path) -> None:
        """Writes an .npz of all but the config."""
        np.savez(path, allow_pickle=False, **vars(self.normalization), **self.weights)

    @classmethod
    def load(cls, path: Path, config: PointPolicyConfig) -> "TrainedPointPolicy":
        """Returns the policy that `save` wrote.

        Raises:
            InvalidValueError: if the file is damaged.
        """
        try:
            with np.load(path) as file:
                weights = dict(file)
            normalization = Normalization(weights.pop("lower"), weights.pop("upper"))
        except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise InvalidValueError(
                f"The trained policy {path} is damaged: {error}.",
                remedy="Delete it; the next study trains it again.",
            ) from error
        return cls(config, normalization, weights)
