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

    The last layer starts at zero, so that the displacement does, too.

    Args:
        hidden_units: Width of the layers.
        hidden_layers: Sine layers after the first.
        frequency: omega_0: activations are sin(omega_0 (W x + b)).
        seed: Of the first weights; the global generator is left alone.
    """

    def __init__(self, *, hidden_units: int, hidden_layers: int, frequency: float, seed: int):
        super().__init__()
        self._frequency = frequency
        sizes = [3] + [hidden_units] * (hidden_layers + 1)
        layers = [nn.Linear(a, b) for a, b in itertools.pairwise(sizes)]
        self._layers = nn.ModuleList(layers)
        self._last = nn.Linear(hidden_units, 3)
        generator = torch.Generator().manual_seed(seed)
        with torch.no_grad():
            for k, layer in enumerate(layers):
                inputs = layer.in_features
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
        """Returns the displacements (P, 3) of points (P, 3) as an array."""
        with torch.no_grad():
            return self(torch.as_tensor(points, dtype=torch.float32)).numpy().astype(float)

    def snapshot(self) -> dict[str, torch.Tensor]:
        """Returns a copy of all weights."""
        return {name: value.clone() for name, value in self.state_dict().items()}

    def restore(self, snapshot: dict[str, torch.Tensor]) -> None:
        """Sets all weights."""
        self.load_state_dict(snapshot)
