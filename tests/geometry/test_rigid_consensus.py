import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poil_drake.geometry.rigid_consensus import RigidConsensusConfig
from poil_drake.geometry.rigid_consensus import rigid_inliers as dut
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

CONFIG = RigidConsensusConfig(inlier_distance=0.005)


def moved(rng, count):
    source = rng.normal(scale=0.03, size=(count, 3))
    X = make_transform(rotation_exp(2.0 * rng.normal(size=3)), rng.normal(size=3))
    return source, transform_points(X, source)


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=50)
def test_rigid_motion_has_no_outliers_whatever_its_angle(seed):
    rng = np.random.default_rng(seed)
    source, target = moved(rng, 10)

    assert dut(source, target + rng.normal(scale=1e-3, size=(10, 3)), config=CONFIG).all()


@pytest.mark.parametrize("count", [10, 24])
def test_points_that_went_elsewhere_are_outliers(count):
    rng = np.random.default_rng(0)
    source, target = moved(rng, count)
    target[[2, 5, 6]] += [[0.02, 0, 0], [0, -0.05, 0], [0, 0.1, 0.1]]

    inliers = dut(source, target, config=CONFIG)

    np.testing.assert_array_equal(inliers, ~np.isin(np.arange(count), [2, 5, 6]))


def test_three_points_or_a_line_cannot_tell_outliers():
    line = np.linspace(0.0, 1.0, 6)[:, None] * np.array([1.0, 0, 0])
    bent = line + np.random.default_rng(1).normal(size=(6, 3))

    assert dut(np.eye(3), 2.0 * np.eye(3), config=CONFIG).all()
    assert dut(line, bent, config=CONFIG).all()
