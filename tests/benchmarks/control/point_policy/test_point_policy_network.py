import numpy as np
import pytest

from poil_drake.benchmarks.control.point_policy.network import (
    Normalization,
    PointPolicyConfig,
    forward,
    initial_weights,
    weight_shapes,
)

CONFIG = PointPolicyConfig(width=32, layers=3)
SHAPES = weight_shapes(CONFIG, points=10)


@pytest.fixture
def weights() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {name: 0.3 * rng.standard_normal(s).astype(np.float32) for name, s in SHAPES.items()}


@pytest.fixture
def inputs() -> np.ndarray:
    return np.random.default_rng(1).standard_normal((5, 10, 30)).astype(np.float32)


def test_numpy_computes_what_torch_trains(
    weights: dict[str, np.ndarray], inputs: np.ndarray
) -> None:
    import torch

    from poil_drake.benchmarks.control.point_policy.training import torch_forward

    tensors = {name: torch.as_tensor(values) for name, values in weights.items()}
    expected = torch_forward(tensors, torch.as_tensor(inputs), CONFIG).numpy()

    outputs = np.stack([forward(weights, sample, CONFIG) for sample in inputs])

    # Both are float32; the outputs are of the order of one.
    assert outputs.dtype == np.float32
    assert outputs.shape == (5, 10, 60)
    np.testing.assert_allclose(outputs, expected, atol=2e-5)


def test_every_point_affects_every_other(
    weights: dict[str, np.ndarray], inputs: np.ndarray
) -> None:
    changed = inputs[0].copy()
    changed[7] += 1.0

    difference = forward(weights, changed, CONFIG) - forward(weights, inputs[0], CONFIG)

    assert np.all(np.abs(difference).max(axis=1) > 1e-3)


def test_only_the_identity_tells_points_apart(
    weights: dict[str, np.ndarray], inputs: np.ndarray
) -> None:
    order = np.random.default_rng(2).permutation(10)
    permuted = weights | {"identity": weights["identity"][order]}

    outputs = forward(permuted, inputs[0][order], CONFIG)

    np.testing.assert_allclose(outputs, forward(weights, inputs[0], CONFIG)[order], atol=1e-5)
    assert not np.allclose(forward(weights, inputs[0][order], CONFIG), outputs, atol=1e-3)


def test_before_training_every_output_is_the_middle_of_the_data(inputs: np.ndarray) -> None:
    first = initial_weights(CONFIG, points=10)

    assert {name: w.shape for name, w in first.items()} == SHAPES
    np.testing.assert_array_equal(forward(first, inputs[0], CONFIG), 0.0)


def test_positions_are_numbers_in_the_box_of_the_data_ordered_by_point() -> None:
    dut = Normalization(np.array([1.0, 2.0, 3.0]), np.array([3.0, 6.0, 4.0]))
    lower, upper, center = np.array([[1.0, 2.0, 3.0], [3.0, 6.0, 4.0], [2.0, 4.0, 3.5]])
    # Two points at three instants.
    stretch = np.array([[lower, center], [upper, center], [center, lower]])

    wanted = [[-1, -1, -1, 1, 1, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0, -1, -1, -1]]
    np.testing.assert_allclose(dut.numbers(stretch), wanted)
    np.testing.assert_allclose(dut.positions(dut.numbers(stretch)), stretch)


def test_box_holds_all_points_of_all_demonstrations() -> None:
    low, high = np.zeros((4, 2, 3)), np.zeros((3, 2, 3))
    low[-1, 1] = [-1.0, -2.0, -3.0]
    high[0, 0] = [4.0, 5.0, 6.0]

    dut = Normalization.of([low, high])

    np.testing.assert_array_equal(dut.lower, [-1.0, -2.0, -3.0])
    np.testing.assert_array_equal(dut.upper, [4.0, 5.0, 6.0])


def test_axis_without_motion_does_not_magnify_noise() -> None:
    demonstration = np.random.default_rng(0).uniform(0.0, 0.3, (10, 4, 3))
    demonstration[..., 2] = 0.1
    dut = Normalization.of([demonstration])

    numbers = dut.numbers(demonstration + 0.001)

    # 1 mm of the smallest half range, 1 mm.
    np.testing.assert_allclose(numbers[..., 2::3], 1.0, rtol=1e-5)
