import numpy as np
import pytest

from poil_drake.control.reference import pose_smoothing as dut
from poil_drake.geometry.rigid_transform import make_transform, rotation_angle, rotation_exp


def screw(times):
    """Turns at (0.3, -0.5, 0.8) rad/s from an oblique start while its origin accelerates."""
    start = rotation_exp(np.array([2.0, 1.0, -1.0]))
    turns = rotation_exp(times[:, None] * np.array([0.3, -0.5, 0.8])) @ start
    origins = np.stack([0.1 * times, 0.02 * times**2, 1.0 - 0.05 * times], axis=1)
    return make_transform(turns, origins)


@pytest.mark.parametrize("uneven", [False, True])
def test_constant_turn_and_quadratic_path_are_kept_exactly(uneven):
    # In 20 s it turns by more than three revolutions.
    times = np.arange(0.0, 20.0, 0.125)
    if uneven:
        times = np.sort(np.random.default_rng(0).uniform(0.0, 20.0, size=160))
        times = np.delete(times, slice(20, 24))
    queries = np.linspace(times[0], times[-1], 97)

    X, V = dut.smooth_poses(times, screw(times), queries, 0.25)

    np.testing.assert_allclose(X, screw(queries), atol=1e-6)
    np.testing.assert_allclose(V[:, :3], np.tile([0.3, -0.5, 0.8], (97, 1)), atol=1e-5)
    v = np.stack([0 * queries + 0.1, 0.04 * queries, 0 * queries - 0.05], axis=1)
    np.testing.assert_allclose(V[:, 3:], v, atol=1e-5)


def test_noise_is_reduced():
    rng = np.random.default_rng(1)
    times = np.arange(0.0, 20.0, 0.125)
    X = screw(times)
    X[:, :3, 3] += rng.normal(scale=1e-3, size=(160, 3))
    X[:, :3, :3] = rotation_exp(rng.normal(scale=0.02, size=(160, 3))) @ X[:, :3, :3]

    smooth, _ = dut.smooth_poses(times, X, times, 0.25)

    error = smooth[:, :3, 3] - screw(times)[:, :3, 3]
    angle = rotation_angle(smooth[:, :3, :3] @ np.swapaxes(screw(times)[:, :3, :3], -1, -2))
    # A local quadratic with Gaussian weights is a filter with the kernel (3 - u^2) / 2 times the
    # Gaussian, which keeps 27 / (32 sqrt(pi)) * period / bandwidth = 0.238 of the variance: 0.49
    # of the deviation.
    assert np.std(error) == pytest.approx(0.49e-3, rel=0.15)
    assert np.sqrt(np.mean(angle**2)) == pytest.approx(0.49 * 0.02 * np.sqrt(3.0), rel=0.15)


def test_smooth_rotations_are_rotations():
    rng = np.random.default_rng(2)
    X = make_transform(rotation_exp(rng.normal(size=(30, 3))), np.zeros((30, 3)))

    R = dut.smooth_poses(np.arange(30.0), X, np.linspace(0.0, 29.0, 100), 2.0)[0][:, :3, :3]

    np.testing.assert_allclose(
        R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
    )


def test_few_samples_are_enough():
    times = np.array([0.0, 0.2, 0.4])

    X, _ = dut.smooth_poses(times, screw(times), times, 0.25)

    np.testing.assert_allclose(X, screw(times), atol=1e-6)


def test_interpolation_is_straight_and_clamped():
    X = make_transform(
        rotation_exp(np.array([[0.0, 0, 0], [0, 0, 1.0]])), np.array([[0.0, 0, 0], [1.0, 2.0, 0]])
    )

    between = dut.interpolate_poses(np.array([0.0, 2.0]), X, np.array([-1.0, 0.5, 2.0, 9.0]))

    np.testing.assert_allclose(between[0], X[0])
    np.testing.assert_allclose(between[1, :3, 3], [0.25, 0.5, 0.0])
    np.testing.assert_allclose(between[1, :3, :3], rotation_exp([0.0, 0.0, 0.25]), atol=1e-15)
    np.testing.assert_allclose(between[2:], X[[1, 1]], atol=1e-15)
