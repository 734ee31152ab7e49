import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_references import seeds

from poil_drake.control.field import twist_fit as dut
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import skew

property_test = settings(derandomize=True, max_examples=100)
LIMIT = 0.015


def even(count):
    return np.full(count, 1.0 / count)


def rigid_velocities(points, omega, v, origin):
    return v + np.cross(omega, points - origin)


@given(seeds, st.integers(3, 30))
@property_test
def test_rigid_motion_is_recovered(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    omega, v = rng.normal(size=(2, 3))
    velocities = rigid_velocities(points, omega, v, points.mean(axis=0))

    fitted_omega, fitted_v, *_ = dut.fit_twist(points, velocities, even(count))

    np.testing.assert_allclose(fitted_omega, omega, atol=1e-7)
    np.testing.assert_allclose(fitted_v, v, atol=1e-12)


@given(seeds)
@property_test
def test_fit_solves_the_stacked_least_squares_problem(seed):
    rng = np.random.default_rng(seed)
    points, velocities = rng.normal(size=(2, 7, 3))
    weights = rng.uniform(0.1, 1.0, size=7)
    arms = points - weights @ points / weights.sum()
    rows = [np.hstack([-skew(arm), np.eye(3)]) for arm in arms]
    root = np.repeat(np.sqrt(weights), 3)
    expected, *_ = np.linalg.lstsq(root[:, None] * np.vstack(rows), root * velocities.ravel())

    omega, v, *_ = dut.fit_twist(points, velocities, weights / weights.sum())

    np.testing.assert_allclose(np.concatenate([omega, v]), expected, atol=1e-10)


@given(seeds)
@property_test
def test_squared_residuals_are_those_of_the_twist_at_every_point(seed):
    rng = np.random.default_rng(seed)
    points, velocities = rng.normal(size=(2, 4, 7, 3))
    shares = np.array([0.2] * 5 + [0.0] * 2)

    fit = dut.fit_twist(points, velocities, shares)
    squares = fit.squared_errors(points, velocities)

    for k in range(4):
        centre = points[k, :5].mean(axis=0)
        left = rigid_velocities(points[k], fit.omega[k], fit.v[k], centre) - velocities[k]
        np.testing.assert_allclose(squares[k], np.sum(left**2, axis=1), rtol=1e-9, atol=1e-12)


def test_collinear_points_get_no_rotation_about_their_line():
    points = np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    velocities = rigid_velocities(points, np.array([5.0, 0.0, 2.0]), np.ones(3), np.zeros(3))

    omega, v, *_ = dut.fit_twist(points, velocities, even(3))

    np.testing.assert_allclose(omega, [0.0, 0.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(v, [1.0, 1.0, 1.0])


def test_single_point_moves_without_turning():
    omega, v, *_ = dut.fit_twist(np.array([[1.0, 2, 3]]), np.array([[4.0, 5, 6]]), even(1))

    np.testing.assert_array_equal(omega, np.zeros(3))
    np.testing.assert_array_equal(v, [4, 5, 6])


@pytest.mark.parametrize("size", [1.0, 100.0])
def test_turn_about_an_axis_near_the_points_is_slowed(size):
    # They are 1 m from their centre along x, 0.1 m along y: closer to the x axis than 0.2 m.
    points = size * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 0.1, 0], [0, -0.1, 0]])
    velocities = rigid_velocities(points, np.ones(3), np.zeros(3), np.zeros(3))

    fit = dut.fit_twist(points, velocities, even(4), 0.2 / np.sqrt(2.0) * size)

    np.testing.assert_allclose(fit.omega, [0.25, 1.0, 1.0])
    assert fit.spread == pytest.approx(0.1 / np.sqrt(2.0) * size)


@pytest.mark.parametrize("count", [10, 24])
def test_outliers_are_found_by_all_and_by_random_triples(count):
    rng = np.random.default_rng(1)
    points = rng.normal(scale=0.03, size=(count, 3))
    omega, v = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.0, -0.05])
    velocities = rigid_velocities(points, omega, v, np.zeros(3))
    velocities[[1, 4, 7]] += [[0.2, 0, 0], [0, -0.3, 0], [0, 0.1, 0.1]]

    inliers = dut.twist_consensus(points, velocities, np.ones(count), LIMIT)

    np.testing.assert_array_equal(inliers, ~np.isin(np.arange(count), [1, 4, 7]))


def test_spread_is_the_distance_from_the_best_fitting_line():
    flat = np.array([[-1.0, 0.1, 0], [-1, -0.1, 0], [1, 0.1, 0], [1, -0.1, 0]])
    solid = np.concatenate([np.diag([1.0, 2.0, 3.0]), -np.diag([1.0, 2.0, 3.0])])

    assert dut.fit_twist(flat, 0.0 * flat, even(4)).spread == pytest.approx(0.1)
    # 2 (1^2 + 2^2) over six points.
    assert dut.fit_twist(solid, 0.0 * solid, even(6)).spread == pytest.approx(np.sqrt(10.0 / 6.0))


def test_fit_to_the_best_triples_inliers_adds_others():
    # Drawn so that the noise in the best three points throws one true point out at first.
    rng = np.random.default_rng(50)
    points = rng.normal(scale=0.03, size=(10, 3))
    motion = rigid_velocities(points, np.array([0.3, -0.2, 0.5]), np.array([0.1, 0, -0.05]), 0.0)
    velocities = motion + rng.normal(scale=0.006, size=(10, 3))
    velocities[[1, 4]] += [[0.2, 0.0, 0.0], [0.0, -0.3, 0.0]]
    true = ~np.isin(np.arange(10), [1, 4])

    inliers = dut.twist_consensus(points, velocities, np.ones(10), LIMIT)

    np.testing.assert_array_equal(inliers, true)


def test_collinear_points_have_no_outliers():
    points = np.linspace(0.0, 1.0, 6)[:, None] * [1.0, 0.0, 0.0]
    velocities = np.random.default_rng(4).normal(size=(6, 3))

    assert dut.twist_consensus(points, velocities, np.ones(6), LIMIT).all()


def test_inliers_are_those_within_the_threshold():
    # One is far off, so that not all can be fitted; two are just within 15 mm/s and just outside.
    points = np.random.default_rng(0).normal(scale=0.03, size=(10, 3))
    velocities = np.zeros((10, 3))
    velocities[[1, 4, 7], 2] = [0.3, 0.014, 0.02]

    inliers = dut.twist_consensus(points, velocities, np.ones(len(points)), LIMIT)

    assert inliers.tolist() == [i not in (1, 7) for i in range(10)]


def test_of_two_halves_the_one_that_agrees_more_closely_wins():
    corners = 0.03 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    velocities = np.zeros((8, 3))
    velocities[:4] = [[0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 0.01]]
    both = np.concatenate([corners, corners + 0.1])

    inliers = dut.twist_consensus(both, velocities, np.ones(len(both)), LIMIT)

    assert inliers.tolist() == [False] * 4 + [True] * 4


def test_shifted_twist_has_the_velocity_of_the_other_point():
    V = np.array([0.0, 0.0, 2.0, 1.0, 0.0, 0.0])

    shifted = dut.shift_twist(V, np.array([3.0, 0.0, 0.0]))

    assert shifted.tolist() == [0.0, 0.0, 2.0, 1.0, 6.0, 0.0]


@pytest.mark.parametrize(
    ("V", "scaled"),
    [
        ([0.3, 0, 0, 0, 0.1, 0], [0.3, 0, 0, 0, 0.1, 0]),
        ([1.0, 0, 0, 0, 0.1, 0], [0.5, 0, 0, 0, 0.05, 0]),
        ([0.1, 0, 0, 0, 0.8, 0], [0.025, 0, 0, 0, 0.2, 0]),
        ([1.0, 0, 0, 0, 0.8, 0], [0.25, 0, 0, 0, 0.2, 0]),
        ([0, 0, np.nan, 0, 0, 0], np.zeros(6)),
        ([0, 0, 0, np.inf, 0, 0], np.zeros(6)),
    ],
)
def test_one_factor_scales_the_whole_twist(V, scaled):
    np.testing.assert_allclose(dut.scale_twist(np.array(V), 0.5, 0.2), scaled)


def test_many_twists_are_scaled_each_by_its_own_factor():
    V = np.random.default_rng(0).normal(size=(4, 5, 6))
    V[1, 2, 4] = np.inf

    scaled = dut.scale_twist(V, 0.5, 0.2)

    for one, other in zip(V.reshape(-1, 6), scaled.reshape(-1, 6), strict=True):
        np.testing.assert_allclose(other, dut.scale_twist(one, 0.5, 0.2), atol=1e-15)


def test_limits_must_be_positive():
    with pytest.raises(InvalidValueError, match="limits"):
        dut.scale_twist(np.zeros(6), 0.0, 1.0)
