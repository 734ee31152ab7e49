"""The optimiser of the non-rigid registration.

Imports torch: import this module inside functions only.
"""

import math
from collections.abc import Iterable

import torch

_BETA_1, _BETA_2 = 0.9, 0.999  # Decay rates of the moments.
_EPSILON = 1e-8  # Keeps the denominator above zero.


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
