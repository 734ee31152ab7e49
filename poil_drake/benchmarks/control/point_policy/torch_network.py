"""The forward pass of `network` in torch, for gradients.

Imports torch: import this module inside functions only.
"""

from collections.abc import Mapping

import torch
from torch.nn import functional

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.network import LAYER_NORM_EPSILON


def forward(
    weights: Mapping[str, torch.Tensor], inputs: torch.Tensor, config: PointPolicyConfig
) -> torch.Tensor:
    """Returns the outputs (B, N, 3 `chunk`) for a batch of inputs (B, N, 3 `history`)."""

    def linear(x: torch.Tensor, name: str) -> torch.Tensor:
        return functional.linear(x, weights[f"{name}.w"], weights[f"{name}.b"])

    x = linear(inputs, "embed") + weights["identity"]
    batch, points, width = x.shape
    for k in range(config.layers):
        attend = linear(_normalized(x), f"{k}.attend")
        split = attend.view(batch, points, 3, config.heads, -1).permute(2, 0, 3, 1, 4)
        mixed = functional.scaled_dot_product_attention(*split.unbind(0))
        x = x + linear(mixed.transpose(1, 2).reshape(batch, points, width), f"{k}.mix")
        hidden = functional.silu(linear(_normalized(x), f"{k}.up"))
        x = x + linear(hidden, f"{k}.down")
    return linear(_normalized(x), "head")


def _normalized(x: torch.Tensor) -> torch.Tensor:
    return functional.layer_norm(x, x.shape[-1:], eps=LAYER_NORM_EPSILON)
