import numpy as np
import pytest

from poil_drake.benchmarks.control.point_policy.network import (
    count_layers,
    forward,
    initial_weights,
    weight_shapes,
)

HEADS = 4
SHAPES = weight_shapes(inputs=30, outputs=60, points=10, width=32, layers=3)


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

    from poil_drake.benchmarks.control.point_policy import torch_network

    tensors = {name: torch.as_tensor(values) for name, values in weights.items()}
    expected = torch_network.forward(tensors, torch.as_tensor(inputs), HEADS).numpy()

    outputs = np.stack([forward(weights, sample, HEADS) for sample in inputs])

    # Both are float32; the outputs are of the order of one.
    assert outputs.dtype == np.float32
    np.testing.assert_allclose(outputs, expected, atol=2e-5)


def test_each_point_gets_an_output(weights: dict[str, np.ndarray], inputs: np.ndarray) -> None:
    assert count_layers(weights) == 3
    assert forward(weights, inputs[0], HEADS).shape == (10, 60)


def test_every_point_sees_every_other(weights: dict[str, np.ndarray], inputs: np.ndarray) -> None:
    changed = inputs[0].copy()
    changed[7] += 1.0

    difference = forward(weights, changed, HEADS) - forward(weights, inputs[0], HEADS)

    assert np.all(np.abs(difference).max(axis=1) > 1e-3)


def test_points_are_told_apart_by_their_identity_only(
    weights: dict[str, np.ndarray], inputs: np.ndarray
) -> None:
    order = np.random.default_rng(2).permutation(10)
    permuted = weights | {"identity": weights["identity"][order]}

    outputs = forward(permuted, inputs[0][order], HEADS)

    np.testing.assert_allclose(outputs, forward(weights, inputs[0], HEADS)[order], atol=1e-5)
    assert not np.allclose(forward(weights, inputs[0][order], HEADS), outputs, atol=1e-3)


def test_before_training_every_output_is_the_middle_of_the_data(inputs: np.ndarray) -> None:
    outputs = forward(initial_weights(SHAPES, seed=0), inputs[0], HEADS)

    np.testing.assert_array_equal(outputs, 0.0)


def test_first_weights_follow_the_seed() -> None:
    first, again, other = (initial_weights(SHAPES, seed) for seed in (0, 0, 1))

    assert {name: w.shape for name, w in first.items()} == SHAPES
    for name in SHAPES:
        np.testing.assert_array_equal(first[name], again[name])
    assert not np.array_equal(first["0.up.w"], other["0.up.w"])
