"""The network of the non-rigid registration, and the optimiser that trains it.

Imports torch: import this module inside functions only.
"""

import itertools
import math
from collections.abc import Iterable

import numpy as np
import torch
from torch import nn

_UNITS = 128  # Width of the layers.
_LAYERS = 4  # Number of sine layers.
_FREQUENCY = 8.0
"""omega_0. With 30, as in OAReg (see `deform_points`), the deformation has wrinkles."""

_BETA_1, _BETA_2 = 0.9, 0.999  # Decay rates of the moments.
_EPSILON = 1e-8  # Keeps the denominator above zero.


class DisplacementNetwork(nn.Module):
    """SIREN (Sitzmann et al., NeurIPS 2020) with three inputs and three outputs.

    Its activations are sin(omega_0 (W x + b)). The weights of the last layer start at zero, so the
    initial displacements are zero. The other weights do not depend on the global generator.
    """

    def __init__(self) -> None:
        super().__init__()
        sizes = [3] + [_UNITS] * _LAYERS
        self._layers = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(sizes))
        self._last = nn.Linear(_UNITS, 3)
        generator = torch.Generator().manual_seed(0)
        with torch.no_grad():
            for k, (layer, inputs) in enumerate(zip(self._layers, sizes[:-1], strict=True)):
                bound = 1.0 / inputs if k == 0 else math.sqrt(6.0 / inputs) / _FREQUENCY
                layer.weight.uniform_(-bound, bound, generator=generator)
                layer.bias.uniform_(
                    -1.0 / math.sqrt(inputs), 1.0 / math.sqrt(inputs), generator=generator
                )
            self._last.weight.zero_()
            self._last.bias.zero_()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Returns the displacements (P, 3) of points (P, 3)."""
        for layer in self._layers:
            x = torch.sin(_FREQUENCY * layer(x))
        return self._last(x)

    def displacements(self, points: np.ndarray) -> np.ndarray:
        """Returns the displacements (P, 3) of points (P, 3) as a NumPy array."""
        with torch.no_grad():
            return self(torch.as_tensor(points, dtype=torch.float32)).numpy().astype(float)


class Adam:
    """Adam (Kingma and Ba, ICLR 2015, algorithm 1), with the defaults of `torch.optim.Adam`.

    Unlike PyTorch's optimisers it does not load Triton. Triton brings its own LLVM, which crashes a
    process in which Mesa has rendered with another LLVM.

    Args:
        parameters: The parameters to optimise.
        learning_rate: The step size, alpha.
    """

    def __init__(self, parameters: Iterable[torch.nn.Parameter], *, learning_rate: float):
        self._parameters = list(parameters)
        self._learning_rate = learning_rate
        self._steps = 0
        self._first = [torch.zeros_like(p) for p in self._parameters]
        self._second = [torch.zeros_like(p) for p in self._parameters]

    def zero_grad(self) -> None:
        """Drops the gradients."""
        for parameter in self._parameters:
            parameter.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Moves the parameters down their gradients; those without a gradient stay."""
        self._steps += 1
        rate = self._learning_rate / (1.0 - _BETA_1**self._steps)
        correction = math.sqrt(1.0 - _BETA_2**self._steps)
        for parameter, m, v in zip(self._parameters, self._first, self._second, strict=True):
            if parameter.grad is None:
                continue
            m.lerp_(parameter.grad, 1.0 - _BETA_1)
            v.mul_(_BETA_2).addcmul_(parameter.grad, parameter.grad, value=1.0 - _BETA_2)
            parameter.addcdiv_(m, (v.sqrt() / correction).add_(_EPSILON), value=-rate)
