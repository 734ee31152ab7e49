import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poil_drake.geometry import best_rotation as dut

property_test = settings(derandomize=True, max_examples=200)
seeds = st.integers(0, 2**32 - 1)


def covariance(rng, scales, noise):
    source = rng.normal(size=(8, 3)) * scales
    source -= source.mean(axis=0)
    turn = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi, size=3)).as_matrix()
    target = source @ turn.T + rng.normal(scale=noise, size=(8, 3))
    return (target - target.mean(axis=0)).T @ source, source, target - target.mean(axis=0)


def rotation_of(B):
    return np.reshape(dut.best_rotation(B.tolist()), (3, 3))


@given(seeds, st.floats(0.0, 2.0), st.floats(0.0, 12.0), st.floats(-4.0, -1.0))
@property_test
def test_rotation_is_as_good_as_scipys(seed, first, second, noise):
    # From bodies to plates and rods, nearly flat ones included.
    rng = np.random.default_rng(seed)
    B, source, target = covariance(rng, [1.0, 10.0**-first, 10.0**-second], 10.0**noise)
    expected, _ = Rotation.align_vectors(target, source)

    R = rotation_of(B)

    left = np.linalg.norm(target - source @ R.T)
    best = np.linalg.norm(target - source @ expected.as_matrix().T)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-11)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert left == pytest.approx(best, rel=1e-9, abs=1e-12)


def test_exact_motion_is_recovered_at_any_angle():
    rng = np.random.default_rng(0)
    for angle in (0.0, 1e-9, 1.0, 3.0, np.pi):
        R = Rotation.from_rotvec(angle * np.array([0.6, 0.0, 0.8])).as_matrix()
        source = rng.normal(size=(10, 3))

        np.testing.assert_allclose(rotation_of(R @ source.T @ source), R, atol=1e-13)


@given(seeds)
@property_test
def test_a_mirror_image_still_gets_the_best_rotation(seed):
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(3, 3))
    B *= -np.sign(np.linalg.det(B))
    s = np.linalg.svd(B, compute_uv=False)

    R = rotation_of(B)

    assert np.linalg.det(R) == pytest.approx(1.0)
    assert np.trace(R.T @ B) == pytest.approx(s[0] + s[1] - s[2])


@pytest.mark.parametrize("singular_values", [(1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, -1.0)])
def test_one_of_several_best_rotations_is_returned(singular_values):
    B = np.diag(singular_values)

    R = rotation_of(B)

    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert np.trace(R.T @ B) == pytest.approx(sum(singular_values))
