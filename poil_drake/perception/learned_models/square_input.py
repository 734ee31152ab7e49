"""The input of models that see any image as a square."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import torch


def square_input(
    rgb: np.ndarray, side: int, mean: Sequence[float], deviation: Sequence[float]
) -> "torch.Tensor":
    """Returns an image as a normalized tensor (1, 3, side, side), stretched to a square.

    The processors of transformers do the same, but need torchvision, which must match torch.

    Args:
        rgb: (H, W, 3) uint8.
        side: Height and width of the model's input [px].
        mean: Mean of each channel in the training, from 0 to 1.
        deviation: Standard deviation of each channel in the training, from 0 to 1.
    """
    import torch

    pixels = torch.from_numpy(np.array(rgb)).permute(2, 0, 1)[None]
    resized = torch.nn.functional.interpolate(
        pixels, size=(side, side), mode="bilinear", antialias=True
    )
    shape = (1, 3, 1, 1)
    return (resized / 255.0 - torch.tensor(mean).view(shape)) / torch.tensor(deviation).view(shape)
