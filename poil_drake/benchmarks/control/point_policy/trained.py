"""A trained network and what it needs to predict; a file holds all of it."""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.network import forward, weight_shapes
from poil_drake.benchmarks.control.point_policy.normalization import Normalization
from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class TrainedPointPolicy:
    """Predicts where points go.

    Attributes:
        config: How it was trained.
        normalization: Statistics of the demonstrations.
        weights: Of `network.forward`, float32.
        losses: (L,) mean of the loss over equal stretches of the training, first to last.
    """

    config: PointPolicyConfig
    normalization: Normalization
    weights: Mapping[str, np.ndarray]
    losses: np.ndarray

    def __post_init__(self) -> None:
        shapes = network_shapes(self.config, self.points)
        found = {name: values.shape for name, values in self.weights.items()}
        if found != shapes or not all(np.isfinite(w).all() for w in self.weights.values()):
            raise InvalidValueError(
                "The weights of Point Policy are not those of its settings, or not finite.",
                remedy="Train it again.",
            )

    @property
    def points(self) -> int:
        """How many points it was trained on."""
        return len(self.weights["identity"])

    def predict(self, history: np.ndarray) -> np.ndarray:
        """Returns the next positions (K, N, 3) after a history (H, N, 3), oldest first [m, world].

        Raises:
            InvalidValueError: if the history has another shape.
        """
        wanted = (self.config.history, self.points, 3)
        if history.shape != wanted:
            raise InvalidValueError(
                f"The history has shape {history.shape}, but {wanted} was trained.",
                remedy="Pass as many observations of the same points.",
            )
        outputs = forward(self.weights, self.normalization.inputs(history), self.config.heads)
        return self.normalization.positions(outputs)

    def save(self, file: BinaryIO) -> None:
        """Writes an .npz, without pickles."""
        arrays = {f"weights/{name}": values for name, values in self.weights.items()}
        arrays |= {f"normalization/{k}": v for k, v in vars(self.normalization).items()}
        arrays |= {"config": np.array(json.dumps(asdict(self.config))), "losses": self.losses}
        np.savez(file, allow_pickle=False, **arrays)

    @classmethod
    def load(cls, path: Path) -> "TrainedPointPolicy":
        """Returns what `save` wrote.

        Raises:
            InvalidValueError: if the file is damaged or incomplete.
            FileNotFoundError: if there is none.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            return cls(
                PointPolicyConfig(**json.loads(str(arrays["config"]))),
                Normalization(**_group(arrays, "normalization/")),
                _group(arrays, "weights/"),
                arrays["losses"],
            )
        except FileNotFoundError:
            raise
        except (OSError, EOFError, ValueError, TypeError, KeyError, zipfile.BadZipFile) as error:
            raise InvalidValueError(
                f"{path} is not a trained Point Policy: {error}.", remedy="Train it again."
            ) from error


def network_shapes(config: PointPolicyConfig, points: int) -> dict[str, tuple[int, ...]]:
    """Returns the shapes of the weights for some number of points."""
    return weight_shapes(
        inputs=3 * config.history,
        outputs=3 * config.chunk,
        points=points,
        width=config.width,
        layers=config.layers,
    )


def _group(arrays: Mapping[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """Returns the arrays whose names start with a prefix, by the rest of their names."""
    return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}
