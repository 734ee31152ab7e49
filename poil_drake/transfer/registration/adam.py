"""The optimiser of the non-rigid registration.

Imports torch: import this module inside functions only.
"""

import math
from collections.abc import Iterable

import torch


class Adam:
    """Adam (Kingma and Ba, ICLR 2015, algorithm 1), as `torch.optim.Adam` does it by default.

    That one loads `torch._dynamo` when it is made, and with it, where PyTorch is built for CUDA,
    Triton and its LLVM. In a process that has rendered with Mesa, which has an LLVM of its own,
    this crashes.

    Args:
        parameters: What to optimise; their gradients are read.
        learning_rate: The step size, alpha.
        decays: Decay rates of the moments, beta_1 and beta_2.
        epsilon: What keeps the denominator from zero.
    """

    def __init__(
        self,
        parameters: Iterable[torch.nn.Parameter],
        *,
        learning_rate: float,
        decays: tuple[float, float] = (0.9, 0.999),
        epsilon: float = 1e-8,
    ):
        self._parameters = list(parameters)
        self._learning_rate, self._decays, self._epsilon = learning_rate, decays, epsilon
        self._steps = 0
        self._first = [torch.zeros_like(p) for p in self._parameters]
        self._second = [torch.zeros_like(p) for p in self._parameters]

    def zero_grad(self) -> None:
        """Forgets the gradients."""
        for parameter in self._parameters:
            parameter.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Moves the parameters along their gradients; those without one stay."""
        self._steps += 1
        beta_1, beta_2 = self._decays
        rate = self._learning_rate / (1.0 - beta_1**self._steps)
        correction = math.sqrt(1.0 - beta_2**self._steps)
        for parameter, m, v in zip(self._parameters, self._first, self._second, strict=True):
            if parameter.grad is None:
                continue
            m.lerp_(parameter.grad, 1.0 - beta_1)
            v.mul_(beta_2).addcmul_(parameter.grad, parameter.grad, value=1.0 - beta_2)
            parameter.addcdiv_(m, (v.sqrt() / correction).add_(self._epsilon), value=-rate)
