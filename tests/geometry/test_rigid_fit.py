import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_fit import kabsch as dut
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

property_test = settings(derandomize=True, max_examples=100)


def random_transform(rng):
    return make_transform(rotation_exp(rng.normal(size=3)), rng.normal(size=3))


@given(st.integers(0, 2**32 - 1), st.integers(3, 20))
@property_test
def test_exact_motion_is_recovered(seed, count):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(count, 3))
    X = random_transform(rng)

    np.testing.assert_allclose(dut(source, transform_points(X, source)), X, atol=1e-9)


@given(st.integers(0, 2**32 - 1))
@property_test
def test_noisy_weighted_rotation_agrees_with_scipy(seed):
    rng = np.random.default_rng(seed)
    source, target = rng.normal(size=(2, 8, 3))
    weights = rng.uniform(0.1, 1.0, size=8)
    share = weights / weights.sum()
    centred_source, centred_target = source - share @ source, target - share @ target
    expected, _ = Rotation.align_vectors(centred_target, centred_source, weights)

    X = dut(source, target, weights)

    np.testing.assert_allclose(X[:3, :3], expected.as_matrix(), atol=1e-7)
    np.testing.assert_allclose(X[:3, :3] @ (share @ source) + X[:3, 3], share @ target, atol=1e-12)


def test_mirrored_and_planar_points_get_a_rotation():
    source = np.random.default_rng(0).normal(size=(6, 3))
    plane = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 1, 0]])
    X = random_transform(np.random.default_rng(1))

    mirrored = dut(source, source * [1.0, 1.0, -1.0])

    assert np.linalg.det(mirrored[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(dut(plane, transform_points(X, plane)), X, atol=1e-12)


def test_collinear_points_are_mapped_onto_their_targets():
    source = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    target = transform_points(random_transform(np.random.default_rng(2)), source)

    X = dut(source, target)

    np.testing.assert_allclose(transform_points(X, source), target, atol=1e-12)
    np.testing.assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)


def test_points_of_weight_zero_may_be_nan():
    rng = np.random.default_rng(3)
    source = rng.normal(size=(5, 3))
    X = random_transform(rng)
    target = transform_points(X, source)
    target[2] = np.nan

    np.testing.assert_allclose(dut(source, target, np.array([1.0, 1, 0, 1, 1])), X, atol=1e-12)


def test_many_fits_at_once_equal_one_by_one():
    rng = np.random.default_rng(4)
    source, target = rng.normal(size=(2, 6, 5, 3))

    X = dut(source, target)

    for k in range(6):
        np.testing.assert_allclose(X[k], dut(source[k], target[k]), atol=1e-12)


@pytest.mark.parametrize("weights", [[0.0, 0.0, 0.0], [1.0, -1.0, 1.0], [1.0, 1.0]])
def test_invalid_weights_and_different_counts_are_rejected(weights):
    with pytest.raises(InvalidValueError, match="weights"):
        dut(np.eye(3), np.eye(3), np.array(weights))
    with pytest.raises(InvalidValueError, match=r"\(4, 3\)"):
        dut(np.eye(3), np.zeros((4, 3)))
