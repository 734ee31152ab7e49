"""A small network with sine activations that maps points to displacements.

Imports torch: import this module inside functions only.
"""

import itertools
import math

import numpy as np
import torch
from torch import nn


class DisplacementNetwork(nn.Module):
    """SIREN (Sitzmann et al., NeurIPS 2020) with three inputs and three outputs.

    The weights of the last layer start at zero, so the initial displacements are zero.

    Args:
        hidden_units: Width of the layers.
        hidden_layers: Number of sine layers after the first one.
        frequency: omega_0 in the activations sin(omega_0 (W x + b)).
        seed: Seed of the initial weights; they do not depend on the global generator.
    """

    def __init__(self, *, hidden_units: int, hidden_layers: int, frequency: float, seed: int):
        super().__init__()
        self._frequency = frequency
        sizes = [3] + [hidden_units] * (hidden_layers + 1)
        self._layers = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(sizes))
        self._last = nn.Linear(hidden_units, 3)
        generator = torch.Generator().manual_seed(seed)
        with torch.no_grad():
            for k, (layer, inputs) in enumerate(zip(self._layers, sizes[:-1], strict=True)):
                bound = 1.0 / inputs if k == 0 else math.sqrt(6.0 / inputs) / frequency
                layer.weight.uniform_(-bound, bound, generator=generator)
                layer.bias.uniform_(
                    -1.0 / math.sqrt(inputs), 1.0 / math.sqrt(inputs), generator=generator
                )
            self._last.weight.zero_()
            self._last.bias.zero_()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Returns the displacements (P, 3) of points (P, 3)."""
        for layer in self._layers:
            x = torch.sin(self._frequency * layer(x))
        return self._last(x)

    def displacements(self, points: np.ndarray) -> np.ndarray:
        """Returns the displacements (P, 3) of points (P, 3) as a NumPy array."""
        with torch.no_grad():
            return self(torch.as_tensor(points, dtype=torch.float32)).numpy().astype(float)
