import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.transfer import non_rigid_registration
from poil_drake.transfer.non_rigid_registration import deform_points, local_reconstruction_weights

Maker = Callable[..., PointCloud]


@pytest.fixture(autouse=True)
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of the usual points, for speed."""
    monkeypatch.setattr(non_rigid_registration, "_MAX_POINTS", 150)


def chamfer(a: np.ndarray, b: np.ndarray) -> float:
    return float(cKDTree(b).query(a)[0].mean() + cKDTree(a).query(b)[0].mean())


def bent(points: np.ndarray) -> np.ndarray:
    """Leans a handle sideways, quadratically with height: 5 mm at its top."""
    height = (points[:, 2] - points[:, 2].min()) / np.ptp(points[:, 2])
    return points + 0.005 * height[:, None] ** 2 * [0.0, 1.0, 0.0]


def test_equal_clouds_are_not_deformed(make_handle: Maker) -> None:
    points = make_handle().points

    np.testing.assert_allclose(deform_points(points, points, points), points, atol=1e-5)


def test_deforms_a_straight_part_onto_a_bent_one(make_handle: Maker) -> None:
    source, target = make_handle(seed=0).points, bent(make_handle(seed=1).points)

    moved = deform_points(source, target, source)

    assert chamfer(moved, target) < chamfer(source, target)
    truth = bent(source)
    before = np.linalg.norm(source - truth, axis=1).mean()
    assert np.linalg.norm(moved - truth, axis=1).mean() < 0.6 * before


def test_points_keep_their_order_along_the_part(make_handle: Maker) -> None:
    source, target = make_handle(seed=0).points, bent(make_handle(seed=1).points)
    carried = np.stack([np.full(9, 0.06), np.zeros(9), np.linspace(0.03, 0.07, 9)], axis=1)

    moved = deform_points(source, target, carried)

    assert np.all(np.diff(moved[:, 2]) > 0.5 * np.diff(carried[:, 2]))


def test_distant_points_do_not_pull(make_handle: Maker) -> None:
    source = make_handle(seed=0).points
    # A second cloud 40 mm beside the first; the truncation is 7 mm.
    target = np.concatenate([source, source + np.array([0.0, 0.04, 0.0])])

    moved = deform_points(source, target, source)

    assert np.linalg.norm(moved - source, axis=1).max() < 1e-3


def test_the_same_clouds_give_the_same_deformation(
    make_handle: Maker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(non_rigid_registration, "_MAX_STEPS", 5)
    source, target = make_handle(seed=0).points, bent(make_handle(seed=1).points)

    first, second = (deform_points(source, target, source) for _ in range(2))

    np.testing.assert_array_equal(first, second)


def test_reconstruction_weights_are_invariant_to_affine_maps() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(60, 3))
    A, b = rng.normal(size=(3, 3)), rng.normal(size=3)

    indices, weights = local_reconstruction_weights(points, neighbours=12, regularization=1e-9)

    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert not np.any(indices == np.arange(60)[:, None])
    mapped = points @ A.T + b
    rebuilt = np.einsum("pk,pki->pi", weights, mapped[indices])
    np.testing.assert_allclose(rebuilt, mapped, atol=1e-5)


def test_reconstruction_handles_coincident_points() -> None:
    points = np.repeat(np.random.default_rng(0).normal(size=(5, 3)), 4, axis=0)

    indices, weights = local_reconstruction_weights(points, neighbours=3, regularization=1e-3)

    assert np.all(np.isfinite(weights))
    assert not np.any(indices == np.arange(20)[:, None])


def test_steps_of_the_optimiser_are_those_of_the_paper() -> None:
    # Imported here: other tests in this process may not need torch.
    import torch

    from poil_drake.transfer.registration_network import Adam

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
        "from poil_drake.transfer import non_rigid_registration\n"
        "x = np.random.default_rng(0).normal(size=(60, 3))\n"
        "non_rigid_registration._MAX_STEPS = 3\n"
        "non_rigid_registration.deform_points(x, 1.01 * x, x)\n"
        "print(*sorted({'torch._dynamo', 'triton'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
