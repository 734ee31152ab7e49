import numpy as np
import pytest
from hypothesis import given, settings
from point_references import resting_reference, seeds

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus, point_set_bcsdm
from poil_drake.control.field.rollout import rollout
from poil_drake.control.field.twist_fit import fit_twist
from poil_drake.control.theory import degenerate_points as dut
from poil_drake.geometry.rigid_transform import rotation_exp

property_test = settings(derandomize=True, max_examples=50)
SQUARE = 0.03 * np.array([[1.0, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])


def near_line(thickness):
    """Six points along x, `thickness` off it in y, root mean square [m]."""
    x = 0.05 * np.array([-1.0, -0.6, -0.2, 0.2, 0.6, 1.0])
    # Even in x, so that the principal axes are those of the frame.
    y = thickness * np.sqrt(1.5) * np.array([1.0, -1.0, 0.0, 0.0, -1.0, 1.0])
    return np.stack([x, y, 0.0 * x], axis=1)


def test_condition_of_a_set_by_hand():
    # W = diag(2, 8, 18), A = diag(26, 20, 10), six points.
    body = np.concatenate([np.diag([1.0, 2.0, 3.0]), -np.diag([1.0, 2.0, 3.0])])

    condition = dut.point_set_condition(body)

    np.testing.assert_allclose(condition.axis_distances, np.sqrt(np.array([26.0, 20, 10]) / 6.0))
    assert condition.condition == pytest.approx(2.6)
    np.testing.assert_allclose(condition.noise_per_error, 1.0 / np.sqrt([26.0, 20.0, 10.0]))
    assert condition.shape is dut.PointSetShape.SPATIAL
    assert not condition.symmetric


def test_points_of_a_square_are_symmetric():
    condition = dut.point_set_condition(SQUARE)

    assert condition.symmetric
    assert condition.condition == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("body", "shape"),
    [
        (np.full((5, 3), 0.3), "COINCIDENT"),
        (near_line(0.0), "COLLINEAR"),
        (near_line(0.0009), "COLLINEAR"),
        (near_line(0.0011), "COPLANAR"),
        (SQUARE, "COPLANAR"),
        (near_line(0.01) + 0.0011 * np.array([[0, 0, 1], [0, 0, -1]] * 3), "SPATIAL"),
    ],
)
def test_shapes_are_distinguished_by_the_smallest_spread(body, shape):
    assert dut.point_set_condition(body).shape.name == shape


def test_collinear_points_do_not_determine_the_turn_about_their_line():
    condition = dut.point_set_condition(near_line(0.0))

    assert condition.condition == np.inf
    assert np.isfinite(condition.noise_per_error).tolist() == [True, True, False]
    np.testing.assert_allclose(np.abs(condition.axes[:, 2]), [1.0, 0.0, 0.0], atol=1e-12)


@given(seeds)
@property_test
def test_condition_is_independent_of_pose_and_size(seed):
    rng = np.random.default_rng(seed)
    body = rng.normal(size=(7, 3)) * [0.5, 1.0, 2.0]
    turned = 3.0 * body @ rotation_exp(rng.normal(size=3)).T + rng.normal(size=3)

    one, other = dut.point_set_condition(body), dut.point_set_condition(turned)

    assert other.condition == pytest.approx(one.condition, rel=1e-9)
    np.testing.assert_allclose(other.axis_distances, 3.0 * one.axis_distances)
    np.testing.assert_allclose(other.noise_per_error, one.noise_per_error / 3.0)


@pytest.mark.parametrize("weighted", [False, True])
def test_noise_of_the_fitted_rotation_is_as_predicted(weighted):
    rng = np.random.default_rng(0)
    body = near_line(0.01)
    weights = rng.uniform(0.1, 1.0, size=6) if weighted else np.ones(6)
    condition = dut.point_set_condition(body, weights)

    turns = fit_twist(body, rng.normal(size=(4000, 6, 3)), weights / weights.sum()).omega

    # A standard deviation from 4000 samples is known to about 1 %.
    measured = np.std(turns @ condition.axes, axis=0)
    np.testing.assert_allclose(measured, condition.noise_per_error, rtol=0.05)


# The fit and the field with such points.


def fit_turn(body, velocities, min_rotation_spread):
    return fit_twist(body, velocities, np.full(len(body), 1.0 / len(body)), min_rotation_spread)


@pytest.mark.parametrize("thickness", [1e-3, 1e-4, 1e-5, 1e-9, 0.0])
def test_noise_is_never_divided_by_less_than_the_smallest_spread(thickness):
    rng = np.random.default_rng(1)
    noise = 1e-3 * rng.normal(size=(2000, 6, 3))
    body = near_line(thickness)

    turns = np.array([fit_turn(body, v, 2e-3).omega for v in noise])
    plain = np.array([fit_turn(body, v, 0.0).omega for v in noise])

    # sigma s / s0^2 over the root of the number of points, below sigma / s0.
    predicted = 1e-3 * thickness / 2e-3**2 / np.sqrt(6.0)
    assert np.std(turns[:, 0]) == pytest.approx(predicted, rel=0.1, abs=2e-7)
    np.testing.assert_allclose(turns[:, 1:], plain[:, 1:], rtol=1e-6, atol=1e-9)
    if thickness > 1e-8:
        assert np.std(plain[:, 0]) == pytest.approx(1e-3 / thickness / np.sqrt(6.0), rel=0.1)


@pytest.mark.parametrize("outlier_test", ["rigidity", "velocity", "none"])
def test_field_slows_the_unobserved_turn_and_still_lowers_the_potential(outlier_test):
    body = near_line(1.2e-3)
    config = BcsdmConfig(eta=3.0, min_rotation_spread=4e-3, outlier_test=outlier_test)
    plain = BcsdmConfig(eta=3.0, outlier_test=outlier_test)
    # About the line, and about another axis.
    turn = rotation_exp(np.array([0.2, 0.0, 0.03]))
    points = body @ turn.T
    reference = resting_reference(body)

    output = point_set_bcsdm(points, reference, config)
    full = point_set_bcsdm(points, reference, plain)

    # (1.2 / 4)^2 of the turn about the line, which 2 mm from it takes the axis of the points.
    line = turn[:, 0]
    assert output.omega @ line == pytest.approx(0.09 * (full.omega @ line), rel=1e-6)
    across = np.eye(3) - np.outer(line, line)
    np.testing.assert_allclose(across @ output.omega, across @ full.omega, atol=1e-9)
    step = 1e-3
    moved = points @ rotation_exp(step * output.omega).T + step * output.v
    assert point_set_bcsdm(moved, reference, config).potential < output.potential


def test_field_is_lost_below_its_smallest_spread_even_if_turns_are_slowed():
    body = near_line(0.9e-3)
    config = BcsdmConfig(min_rotation_spread=4e-3)

    output = point_set_bcsdm(body + 0.1, resting_reference(body), config)

    assert output.status is BcsdmStatus.LOST
    assert not output.twist.any()


def test_coplanar_points_reach_their_goal_from_any_rotation():
    rng = np.random.default_rng(3)
    body = rng.normal(scale=0.03, size=(8, 3)) * [1.0, 0.6, 0.0]
    reference = resting_reference(body)
    for _ in range(10):
        points = body @ rotation_exp(3.0 * rng.normal(size=3)).T

        assert rollout(points, reference, BcsdmConfig(eta=3.0), 0.05, 10.0).converged
