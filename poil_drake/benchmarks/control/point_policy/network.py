"""The transformer over point tokens: its weights, and its forward pass in NumPy.

Each point is one token. A linear layer embeds its history, and a learned vector that identifies the
point is added. Pre-norm transformer layers without a mask follow, and a linear layer outputs the
point's chunk. Layer norms have no learned gains, since a linear layer follows each.
"""

import math
from collections.abc import Mapping

import numpy as np

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig

LAYER_NORM_EPSILON = 1e-5

_EXPANSION = 2
"""Width of the hidden layer between two attention layers, as a multiple of the token length."""

Weights = Mapping[str, np.ndarray]


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
