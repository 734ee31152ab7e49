import numpy as np
import pytest

from poil_drake.control.field.bcsdm_config import BcsdmConfig
from poil_drake.control.field.robust_fit import fit_robust_twist as dut
from poil_drake.geometry.rigid_transform import rotation_exp

CONFIG = BcsdmConfig(eta=3.0)
EVEN = np.ones(8)
OFF = np.array([0.0, 0.0, 0.05])


def body_and_motion(angular_speed):
    """Points, the velocities of a turn about z, and where a turn and a shift take the points."""
    points = np.random.default_rng(0).normal(scale=0.03, size=(8, 3))
    velocities = np.cross([0.0, 0.0, angular_speed], points) + 0.1
    return points, velocities, points @ rotation_exp(np.array([0.3, 1.0, 0.5])).T + 0.2


@pytest.mark.parametrize("angular_speed", [0.1, 2.0])
def test_a_point_is_an_outlier_only_if_neither_twist_nor_motion_explains_it(angular_speed):
    points, velocities, targets = body_and_motion(angular_speed)
    off, gone = velocities.copy(), targets.copy()
    off[2] += 3.0 * OFF
    gone[2] += OFF

    by_twist = dut(points, velocities, gone, EVEN, CONFIG, equal_weights=True)
    by_motion = dut(points, off, targets, EVEN, CONFIG, equal_weights=True)
    by_neither = dut(points, off, gone, EVEN, CONFIG, equal_weights=True)

    assert by_twist.inliers.all()
    assert by_motion.inliers.all()
    assert by_neither.inliers.tolist() == [i != 2 for i in range(8)]


@pytest.mark.parametrize("unobserved", [0, 1])
@pytest.mark.parametrize("angular_speed", [0.1, 2.0])
def test_no_point_is_an_outlier_if_one_motion_explains_all(angular_speed, unobserved):
    # Drawn so that the motion leaves 4.3 mm at most, but the best triple leaves some point above 5.
    rng = np.random.default_rng(0)
    targets = rng.normal(scale=0.03, size=(10, 3))
    points = targets + rng.normal(scale=0.002, size=(10, 3))
    velocities = np.cross([0.0, 0.0, angular_speed], points)
    velocities[2] += 3.0 * OFF
    elsewhere = (np.full((unobserved, 3), x) for x in (0.0, 7.0, -3.0))
    given = [np.vstack(both) for both in zip((points, velocities, targets), elsewhere, strict=True)]
    weights = np.array([1.0] * 10 + [0.0] * unobserved)

    fit = dut(*given, weights, CONFIG, equal_weights=unobserved == 0)

    assert fit.inliers.tolist() == [True] * 10 + [False] * unobserved


@pytest.mark.parametrize("outlier_test", ["rigidity", "velocity", "none"])
def test_points_without_weight_are_ignored_and_not_inliers(outlier_test):
    points, velocities, targets = body_and_motion(0.1)
    config = BcsdmConfig(outlier_test=outlier_test)
    weights = np.linspace(0.3, 1.0, 8)
    weights[5] = 0.0
    kept = weights > 0.0
    expected = dut(
        points[kept], velocities[kept], targets[kept], weights[kept], config, equal_weights=False
    )
    points[5], velocities[5], targets[5] = 0.0, 7.0, -3.0

    fit = dut(points, velocities, targets, weights, config, equal_weights=False)

    assert fit.inliers.tolist() == kept.tolist()
    np.testing.assert_allclose(fit.omega, expected.omega, atol=1e-12)
    np.testing.assert_allclose(fit.v, expected.v, atol=1e-12)
    np.testing.assert_allclose(fit.centroid, expected.centroid, atol=1e-12)
    assert fit.spread == pytest.approx(expected.spread)


def test_mask_of_inliers_includes_unobserved_points():
    points, velocities, targets = body_and_motion(0.1)
    weights = EVEN.copy()
    weights[1] = 0.0
    velocities[4] += 3.0 * OFF
    targets[4] += OFF

    for outlier_test in ("rigidity", "velocity"):
        config = BcsdmConfig(outlier_test=outlier_test)
        fit = dut(points, velocities, targets, weights, config, equal_weights=False)

        assert fit.inliers.tolist() == [i not in (1, 4) for i in range(8)]
