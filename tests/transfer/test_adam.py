"""The optimiser, against PyTorch's own, which runs in a process of its own."""

import json
import subprocess
import sys

import numpy as np

STEPS = """
import json, sys, torch
torch.set_num_threads(1)
torch.manual_seed(0)
goals = [torch.randn(4, 3), torch.randn(5)]
weights = [torch.nn.Parameter(torch.randn_like(goal)) for goal in goals]
unused = torch.nn.Parameter(torch.ones(2))
if sys.argv[1] == "ours":
    from poil_drake.transfer.adam import Adam
    optimizer = Adam([*weights, unused], learning_rate=0.05)
else:
    optimizer = torch.optim.Adam([*weights, unused], lr=0.05)
for _ in range(60):
    loss = sum(((w - g) ** 4).sum() + (w * g).sum() for w, g in zip(weights, goals))
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
loaded = sorted({"torch._dynamo", "triton"} & sys.modules.keys())
print(json.dumps({
    "weights": [w.detach().ravel().tolist() for w in [*weights, unused]], "loaded": loaded
}))
"""


def run(whose: str) -> dict:
    done = subprocess.run(
        [sys.executable, "-c", STEPS, whose], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def test_steps_are_those_of_pytorch_without_its_compiler() -> None:
    ours, theirs = run("ours"), run("theirs")

    for a, b in zip(ours["weights"], theirs["weights"], strict=True):
        # Single precision; both round in their own order.
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6)
    assert ours["loaded"] == []


def test_the_registration_loads_no_compiler() -> None:
    code = (
        "import sys, numpy as np\n"
        "from poil_drake.transfer.non_rigid import NonRigidConfig, register_non_rigid\n"
        "x = np.random.default_rng(0).normal(size=(60, 3))\n"
        "register_non_rigid(x, 1.01 * x, config=NonRigidConfig(max_steps=3)).apply(x)\n"
        "print(*sorted({'torch._dynamo', 'triton'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
