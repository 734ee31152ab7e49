"""The forward pass of `network` in torch, through which gradients flow.

Imports torch: import this module inside functions only.
"""

from collections.abc import Mapping

import torch
from torch.nn import functional

from poil_drake.benchmarks.control.point_policy.network import LAYER_NORM_EPSILON, count_layers


def forward(weights: Mapping[str, torch.Tensor], inputs: torch.Tensor, heads: int) -> torch.Tensor:
    """Returns the outputs (B, N, O) for inputs (B, N, F)."""
    x = functional.linear(inputs, weights["embed.w"], weights["embed.b"]) + weights["identity"]
    batch, points, width = x.shape
    for k in range(count_layers(weights)):
        attend = functional.linear(
            _normalized(x), weights[f"{k}.attend.w"], weights[f"{k}.attend.b"]
        )
        split = attend.view(batch, points, 3, heads, -1).permute(2, 0, 3, 1, 4)
        query, key, value = split.unbind(0)
        mixed = functional.scaled_dot_product_attention(query, key, value)
        mixed = mixed.transpose(1, 2).reshape(batch, points, width)
        x = x + functional.linear(mixed, weights[f"{k}.mix.w"], weights[f"{k}.mix.b"])
        hidden = functional.linear(_normalized(x), weights[f"{k}.up.w"], weights[f"{k}.up.b"])
        hidden = functional.silu(hidden)
        x = x + functional.linear(hidden, weights[f"{k}.down.w"], weights[f"{k}.down.b"])
    return functional.linear(_normalized(x), weights["head.w"], weights["head.b"])


def _normalized(x: torch.Tensor) -> torch.Tensor:
    return functional.layer_norm(x, x.shape[-1:], eps=LAYER_NORM_EPSILON)
