"""The network of Point Policy: settings, weights, forward pass in NumPy, normalization.

It is a transformer in which each point is one token. A linear layer embeds the point's history, and
a learned vector that identifies the point is added. Pre-norm transformer layers without a mask
follow, and a linear layer outputs the point's chunk. Layer norms have no learned gains, since a
linear layer follows each.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

LAYER_NORM_EPSILON = 1e-5

_EXPANSION = 2
"""Width of the hidden layer between two attention layers, as a multiple of the token length."""

_SMALLEST_HALF_RANGE = 1e-3
"""Lower bound of half the size of the box of `Normalization` [m]. Without it, noise would be
magnified along an axis on which the data hardly vary."""

Weights = Mapping[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class PointPolicyConfig:
    """How the network is built, trained and executed.

    Attributes:
        period: Time between two samples of a demonstration, and between two steps of the policy
            [s]. 1/16 s is exact in binary and makes a chunk reach 1.25 s ahead.
        history: Number of observations the network sees, with the current one; as in the paper.
        chunk: Number of future positions predicted for each point; as in the paper.
        aggregation_rate: m in the weights exp(-m i) of overlapping chunks, where i = 0 is the
            oldest chunk (Zhao et al., RSS 2023); as in the paper.
        width: Length of a token. The paper uses 256, on a GPU; 64 trains in under a minute on one
            core.
        layers: Number of transformer layers; the paper uses 4.
        heads: Number of attention heads; divides `width`.
        steps: Number of optimisation steps; the paper uses 100,000. After 5,000, the points come to
            rest within 1 mm of a demonstrated goal unless something blocks them.
        batch: Windows per step. The paper uses 64; 32 take half the time.
        learning_rate: Peak learning rate, which decays to zero along half a cosine. The paper uses
            1e-4, for twenty times as many steps.
        warm_up: Share of the steps in which the learning rate rises linearly.
        translation_noise: Standard deviation of the shift of the observations in a window, along
            each axis [m]; see `perturb_histories`. The published method has none.
        rotation_noise: Standard deviation of the window's rotation about each axis [rad]. 0.05 rad
            moves a point 10 cm from the centroid by 5 mm. The published method has none.
        halt_probability: Share of the training windows whose points seem to have stopped, as
            after a contact, so that a blocked policy learns to continue. The published method has
            none.
        rest: Number of samples at rest appended to each demonstration, so that the policy learns to
            stay at the goal. The paper appends `history` samples; with more, the policy also learns
            to stay once its whole history is at rest.
        seed: Seed of the initial weights, the batches and the noise.
    """

    period: float = 1.0 / 16.0
    history: int = 10
    chunk: int = 20
    aggregation_rate: float = 0.01
    width: int = 64
    layers: int = 2
    heads: int = 4
    steps: int = 5_000
    batch: int = 32
    learning_rate: float = 2e-3
    warm_up: float = 0.05
    translation_noise: float = 0.005
    rotation_noise: float = 0.05
    halt_probability: float = 0.1
    rest: int = 24
    seed: int = 0


def weight_shapes(config: PointPolicyConfig, points: int) -> dict[str, tuple[int, ...]]:
    """Returns the name and shape of every weight for a number of points.

    Matrices (outputs, inputs) end in ".w", biases in ".b"; "identity" has a vector for each point.
    """
    width = config.width
    linear = {"embed": (width, 3 * config.history)}
    for k in range(config.layers):
        linear |= {
            f"{k}.attend": (3 * width, width),
            f"{k}.mix": (width, width),
            f"{k}.up": (_EXPANSION * width, width),
            f"{k}.down": (width, _EXPANSION * width),
        }
    linear["head"] = (3 * config.chunk, width)
    shapes: dict[str, tuple[int, ...]] = {"identity": (points, width)}
    for name, shape in linear.items():
        shapes |= {f"{name}.w": shape, f"{name}.b": shape[:1]}
    return shapes


def initial_weights(config: PointPolicyConfig, points: int) -> dict[str, np.ndarray]:
    """Returns the initial weights: Glorot's for matrices, zero for biases and the output layer.

    The output matrices of residual branches are divided by the square root of the number of
    branches, as in GPT-2 (Radford et al., 2019). The "identity" vectors are standard normal.
    """
    rng = np.random.default_rng(config.seed)
    weights = {}
    for name, shape in weight_shapes(config, points).items():
        spread = 0.0
        if name == "identity":
            spread = 1.0
        elif name.endswith(".w") and name != "head.w":
            spread = math.sqrt(2.0 / sum(shape))
            if name.endswith((".mix.w", ".down.w")):
                spread /= math.sqrt(2 * config.layers)
        weights[name] = (spread * rng.standard_normal(shape)).astype(np.float32)
    return weights


def forward(weights: Weights, inputs: np.ndarray, config: PointPolicyConfig) -> np.ndarray:
    """Returns the outputs (N, 3 `chunk`) for inputs (N, 3 `history`), float32."""
    x = inputs @ weights["embed.w"].T + weights["embed.b"] + weights["identity"]
    points, width = x.shape
    scale = 1.0 / math.sqrt(width // config.heads)
    for k in range(config.layers):
        attend = _normalized(x) @ weights[f"{k}.attend.w"].T + weights[f"{k}.attend.b"]
        query, key, value = attend.reshape(points, 3, config.heads, -1).transpose(1, 2, 0, 3)
        logits = np.float32(scale) * (query @ key.transpose(0, 2, 1))
        share = np.exp(logits - logits.max(axis=-1, keepdims=True))
        share /= share.sum(axis=-1, keepdims=True)
        mixed = (share @ value).transpose(1, 0, 2).reshape(points, width)
        x = x + mixed @ weights[f"{k}.mix.w"].T + weights[f"{k}.mix.b"]
        hidden = _normalized(x) @ weights[f"{k}.up.w"].T + weights[f"{k}.up.b"]
        hidden = hidden / (1.0 + np.exp(-hidden))
        x = x + hidden @ weights[f"{k}.down.w"].T + weights[f"{k}.down.b"]
    return _normalized(x) @ weights["head.w"].T + weights["head.b"]


def _normalized(x: np.ndarray) -> np.ndarray:
    centred = x - x.mean(axis=-1, keepdims=True)
    variance = np.mean(centred * centred, axis=-1, keepdims=True)
    return centred / np.sqrt(variance + np.float32(LAYER_NORM_EPSILON))


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
