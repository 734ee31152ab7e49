"""The transformer over point tokens: its weights, and its forward pass in NumPy.

Each point is one token. Its history enters through one linear layer, to which a learnt vector is
added that says which point it is; pre-norm transformer layers without a mask follow; one linear
layer gives the point's chunk. Layer norms have no gains of their own, since a linear layer follows
each.
"""

import math
from collections.abc import Mapping

import numpy as np

LAYER_NORM_EPSILON = 1e-5
EXPANSION = 2
"""Width of the hidden layer between two attentions, in tokens' lengths."""

Weights = Mapping[str, np.ndarray]


def weight_shapes(
    *, inputs: int, outputs: int, points: int, width: int, layers: int
) -> dict[str, tuple[int, ...]]:
    """Returns the name and shape of every weight; ".w" are (outputs, inputs), ".b" biases.

    Args:
        inputs: Numbers in for each point.
        outputs: Numbers out for each point.
        points: N.
        width: D, length of a token.
        layers: Transformer layers.
    """
    linear = {"embed": (width, inputs)}
    for k in range(layers):
        linear |= {
            f"{k}.attend": (3 * width, width),
            f"{k}.mix": (width, width),
            f"{k}.up": (EXPANSION * width, width),
            f"{k}.down": (width, EXPANSION * width),
        }
    linear["head"] = (outputs, width)
    shapes: dict[str, tuple[int, ...]] = {"identity": (points, width)}
    for name, shape in linear.items():
        shapes |= {f"{name}.w": shape, f"{name}.b": shape[:1]}
    return shapes


def initial_weights(shapes: Mapping[str, tuple[int, ...]], seed: int) -> dict[str, np.ndarray]:
    """Returns the first weights: Glorot's for matrices, zero for biases and the head.

    What a layer adds to the tokens starts small, by the square root of the number of such
    additions, as in GPT-2 (Radford et al., 2019).
    """
    rng = np.random.default_rng(seed)
    additions = sum(name.endswith((".mix.w", ".down.w")) for name in shapes)
    weights = {}
    for name, shape in shapes.items():
        spread = 0.0
        if name == "identity":
            spread = 1.0
        elif name.endswith(".w") and name != "head.w":
            spread = math.sqrt(2.0 / sum(shape))
            if name.endswith((".mix.w", ".down.w")):
                spread /= math.sqrt(additions)
        weights[name] = (spread * rng.standard_normal(shape)).astype(np.float32)
    return weights


def forward(weights: Weights, inputs: np.ndarray, heads: int) -> np.ndarray:
    """Returns the outputs (N, O) for inputs (N, F), float32."""
    x = inputs @ weights["embed.w"].T + weights["embed.b"] + weights["identity"]
    points, width = x.shape
    scale = 1.0 / math.sqrt(width // heads)
    for k in range(count_layers(weights)):
        attend = _normalized(x) @ weights[f"{k}.attend.w"].T + weights[f"{k}.attend.b"]
        query, key, value = attend.reshape(points, 3, heads, -1).transpose(1, 2, 0, 3)
        logits = np.float32(scale) * (query @ key.transpose(0, 2, 1))
        share = np.exp(logits - logits.max(axis=-1, keepdims=True))
        share /= share.sum(axis=-1, keepdims=True)
        mixed = (share @ value).transpose(1, 0, 2).reshape(points, width)
        x = x + mixed @ weights[f"{k}.mix.w"].T + weights[f"{k}.mix.b"]
        hidden = _normalized(x) @ weights[f"{k}.up.w"].T + weights[f"{k}.up.b"]
        hidden = hidden / (1.0 + np.exp(-hidden))
        x = x + hidden @ weights[f"{k}.down.w"].T + weights[f"{k}.down.b"]
    return _normalized(x) @ weights["head.w"].T + weights["head.b"]


def count_layers(weights: Mapping[str, object]) -> int:
    """Returns how many transformer layers the weights make."""
    return sum(name.endswith(".attend.w") for name in weights)


def _normalized(x: np.ndarray) -> np.ndarray:
    centred = x - x.mean(axis=-1, keepdims=True)
    variance = np.mean(centred * centred, axis=-1, keepdims=True)
    return centred / np.sqrt(variance + np.float32(LAYER_NORM_EPSILON))
