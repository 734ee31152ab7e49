"""Compares the optimiser with the formulas of its paper."""

import subprocess
import sys

import numpy as np


def test_steps_are_those_of_the_paper() -> None:
    # Imported here: other tests in this process may not need torch.
    import torch

    from poil_drake.transfer.registration.network import Adam

    rng = np.random.default_rng(0)
    start, goal = rng.normal(size=(2, 4, 3))
    weights = torch.nn.Parameter(torch.tensor(start))
    unused = torch.nn.Parameter(torch.ones(2))
    dut = Adam([weights, unused], learning_rate=0.05)
    for _ in range(60):
        loss = ((weights - torch.tensor(goal)) ** 4).sum() + (weights * torch.tensor(goal)).sum()
        dut.zero_grad()
        loss.backward()
        dut.step()

    # Kingma and Ba, ICLR 2015, algorithm 1, with the loss's gradient by hand.
    expected, m, v = start.copy(), np.zeros_like(start), np.zeros_like(start)
    for t in range(1, 61):
        gradient = 4.0 * (expected - goal) ** 3 + goal
        m = 0.9 * m + 0.1 * gradient
        v = 0.999 * v + 0.001 * gradient**2
        expected -= 0.05 * (m / (1.0 - 0.9**t)) / (np.sqrt(v / (1.0 - 0.999**t)) + 1e-8)
    np.testing.assert_allclose(weights.detach().numpy(), expected, rtol=1e-12)
    np.testing.assert_array_equal(unused.detach().numpy(), [1.0, 1.0])


def test_the_registration_loads_no_compiler() -> None:
    code = (
        "import sys, numpy as np\n"
        "from poil_drake.transfer.registration import non_rigid\n"
        "x = np.random.default_rng(0).normal(size=(60, 3))\n"
        "non_rigid._MAX_STEPS = 3\n"
        "non_rigid.deform_points(x, 1.01 * x, x)\n"
        "print(*sorted({'torch._dynamo', 'triton'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
