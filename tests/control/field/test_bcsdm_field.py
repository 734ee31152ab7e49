import numpy as np
import pytest
from hypothesis import given, settings
from point_references import (
    moving_reference,
    resting_reference,
    seeds,
    still_reference,
    straight_reference,
)

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus
from poil_drake.control.field.point_set_bcsdm import point_set_bcsdm as dut
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.control.theory.stability import moment_matrix, point_inertia, rotation_velocity
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_exp

property_test = settings(derandomize=True, max_examples=50)

BODY = 0.03 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 0.5], [0, 0, -0.5]])
SPEED = 0.1
CONFIG = BcsdmConfig(eta=3.0)


STRAIGHT = straight_reference(BODY, 17, speed=SPEED)


def random_reference(rng):
    turns = rotation_exp(np.outer(np.linspace(0, 1.5, 20), rng.normal(size=3)))
    path = np.cumsum(rng.normal(scale=0.02, size=(20, 3)), axis=0)
    return moving_reference(BODY @ np.swapaxes(turns, -1, -2) + path[:, None], 0.1)


def test_points_on_the_reference_move_with_it():
    output = dut(STRAIGHT.positions[4], STRAIGHT, CONFIG)

    np.testing.assert_allclose(output.v, [SPEED, 0, 0], atol=1e-12)
    np.testing.assert_allclose(output.omega, np.zeros(3), atol=1e-12)
    assert output.tau == STRAIGHT.times[4]
    assert output.potential == pytest.approx(0.0, abs=1e-20)
    assert output.status is BcsdmStatus.OK


def test_points_beside_the_reference_are_drawn_to_it():
    output = dut(STRAIGHT.positions[4] + np.array([0.0, 0.02, 0.0]), STRAIGHT, CONFIG)

    # POIL eq. 2: the reference's velocity, and 3 / s times 0.02 m.
    np.testing.assert_allclose(output.v, [SPEED, -0.06, 0.0], atol=1e-12)
    np.testing.assert_allclose(output.target_points, STRAIGHT.positions[4])
    assert output.mean_error == pytest.approx(0.02)
    assert output.potential == pytest.approx(0.5 * 6 * 0.02**2)
    np.testing.assert_allclose(output.centroid, [SPEED, 0.02, 0.0], atol=1e-12)


@pytest.mark.parametrize(("interpolate", "tau"), [(True, 1.1), (False, 1.0)])
def test_the_closest_configuration_may_lie_between_samples_or_not(interpolate, tau):
    points = BODY + np.array([SPEED * 1.1, 0.0, 0.0])

    output = dut(points, STRAIGHT, BcsdmConfig(eta=3.0, interpolate=interpolate))

    assert output.tau == pytest.approx(tau)
    assert output.mean_error == pytest.approx(SPEED * (1.1 - tau), abs=1e-12)
    np.testing.assert_allclose(output.v, [SPEED - 3.0 * SPEED * (1.1 - tau), 0, 0], atol=1e-12)


@given(seeds)
@property_test
def test_field_moves_with_the_world(seed):
    rng = np.random.default_rng(seed)
    reference = random_reference(rng)
    points = reference.positions[7] + rng.normal(scale=0.01, size=(6, 3))
    R, p = rotation_exp(rng.normal(size=3)), rng.normal(size=3)
    moved_reference = PointTrajectory(
        reference.times, reference.positions @ R.T + p, reference.velocities @ R.T
    )
    output = dut(points, reference, CONFIG)

    moved = dut(points @ R.T + p, moved_reference, CONFIG)

    np.testing.assert_allclose(moved.omega, R @ output.omega, atol=1e-9)
    np.testing.assert_allclose(moved.v, R @ output.v, atol=1e-10)
    assert moved.tau == pytest.approx(output.tau, abs=1e-9)
    assert moved.potential == pytest.approx(output.potential, rel=1e-9)


@given(seeds)
@property_test
def test_at_rest_the_field_is_the_gradient_flow_of_the_potential(seed):
    rng = np.random.default_rng(seed)
    body = rng.normal(size=(10, 3))
    body -= body.mean(axis=0)
    R, offset = rotation_exp(2.0 * rng.normal(size=3)), rng.normal(size=3)
    W = moment_matrix(body)
    step = 1e-6

    output = dut(body @ R.T + offset, resting_reference(body), CONFIG)
    turn = rotation_exp(step * output.omega)
    moved = body @ (turn @ R).T + offset + step * output.v
    after = dut(moved, resting_reference(body), CONFIG)

    omega = rotation_velocity(W, R)
    np.testing.assert_allclose(output.omega, 3.0 * R @ omega, atol=1e-10)
    np.testing.assert_allclose(output.v, -3.0 * offset, atol=1e-12)
    rate = -3.0 * (omega @ point_inertia(W) @ omega + 10 * offset @ offset)
    assert (after.potential - output.potential) / step == pytest.approx(rate, rel=1e-3)


def test_unobserved_points_are_excluded():
    points = STRAIGHT.positions[4] + np.array([0.0, 0.02, 0.0])
    expected = dut(points, STRAIGHT, CONFIG)
    points[1] = np.nan
    points[3] += 0.5

    output = dut(points, STRAIGHT, CONFIG, np.array([1.0, 1.0, 1.0, 0.0, np.nan, 1.0]))

    np.testing.assert_allclose(output.twist, expected.twist, atol=1e-12)
    assert output.inliers.tolist() == [True, False, True, False, False, True]
    assert output.mean_error == pytest.approx(0.02)
    assert output.goal_error == pytest.approx(expected.goal_error)
    # Without confidences NaN excludes a point too.
    points[3] -= 0.5
    without = dut(points, STRAIGHT, CONFIG)
    np.testing.assert_allclose(without.twist, expected.twist, atol=1e-12)
    assert without.inliers.tolist() == [i != 1 for i in range(6)]


def test_confidence_weighs_the_points():
    # Two points up, two down: the heavier ones dominate the mean velocity.
    body = 0.03 * np.array([[1.0, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    points = body + np.array([[0, 0, 0.001]] * 2 + [[0, 0, -0.001]] * 2)

    output = dut(points, resting_reference(body), CONFIG, np.array([1.0, 1.0, 0.25, 0.25]))

    assert output.v[2] == pytest.approx(-3.0 * 0.001 * (2.0 - 0.5) / 2.5)
    np.testing.assert_allclose(output.centroid, [0.03 * (2.0 - 0.5) / 2.5, 0, 0.0006], atol=1e-12)
    assert output.potential == pytest.approx(0.5 * 2.5 * 0.001**2)


@pytest.mark.parametrize("outlier_test", ["rigidity", "velocity", "none"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, -1.0])
def test_an_invalid_confidence_excludes_its_point(wrong, outlier_test):
    config = BcsdmConfig(eta=3.0, outlier_test=outlier_test)
    confidence = np.ones(6)
    confidence[2] = wrong
    without = np.ones(6)
    without[2] = 0.0
    points = BODY + np.array([0.0, 0.0, 0.01])

    output = dut(points, resting_reference(BODY), config, confidence)

    expected = dut(points, resting_reference(BODY), config, without)
    np.testing.assert_array_equal(output.twist, expected.twist)
    assert output.potential == expected.potential


@pytest.mark.parametrize(
    ("seen", "min_spread"),
    [([0, 1], 0.001), ([0, 1, 4], 0.001), ([], 0.001), ([0, 2], 0.0), ([], 0.0)],
)
def test_too_few_or_collinear_points_are_lost(seen, min_spread):
    body = BODY.copy()
    body[4] = [0.01, 0.0, 0.0]
    confidence = np.zeros(6)
    confidence[seen] = 1.0

    output = dut(body, resting_reference(body), BcsdmConfig(min_spread=min_spread), confidence)

    assert output.status is BcsdmStatus.LOST
    assert not output.twist.any()
    assert np.isnan(output.tau)
    assert np.isnan(output.target_points).all()


def test_a_mistracked_point_is_ignored():
    points = STRAIGHT.positions[4] + np.array([0.0, 0.002, 0.0])
    expected = dut(points, STRAIGHT, CONFIG, np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0]))
    points[2] += [0.05, 0.0, 0.03]

    output = dut(points, STRAIGHT, CONFIG)

    assert output.inliers.tolist() == [True, True, False, True, True, True]
    np.testing.assert_array_equal(output.twist, expected.twist)
    np.testing.assert_array_equal(output.centroid, expected.centroid)
    assert output.tau == expected.tau
    assert output.potential == expected.potential


def test_velocity_test_excludes_the_outlier_from_the_twist_only():
    points = STRAIGHT.positions[4].copy()
    points[2] += [0.0, 0.0, 0.03]

    output = dut(points, STRAIGHT, BcsdmConfig(outlier_test="velocity"))

    assert output.inliers.tolist() == [True, True, False, True, True, True]
    np.testing.assert_allclose(output.twist, [0, 0, 0, SPEED, 0, 0], atol=1e-12)
    assert output.potential == pytest.approx(0.5 * 0.03**2)


def test_without_outlier_test_every_point_counts():
    points = STRAIGHT.positions[4].copy()
    points[2] += [0.0, 0.0, 0.03]

    output = dut(points, STRAIGHT, BcsdmConfig(outlier_test="none"))

    assert output.inliers.all()
    assert output.v[2] == pytest.approx(-3.0 * 0.03 / 6)


def test_large_rotations_do_not_make_outliers():
    points = BODY @ rotation_exp([0.0, 1.5, 1.5]).T

    assert dut(points, resting_reference(BODY), CONFIG).inliers.all()
    velocity = BcsdmConfig(outlier_test="velocity")
    assert not dut(points, resting_reference(BODY), velocity).inliers.all()


def test_goal_is_reached_within_the_tolerance_of_the_end():
    near = STRAIGHT.positions[-1] + np.array([0.0, 0.0029, 0.0])
    far = STRAIGHT.positions[-1] + np.array([0.0, 0.0031, 0.0])

    assert dut(near, STRAIGHT, CONFIG).status is BcsdmStatus.GOAL
    assert dut(far, STRAIGHT, CONFIG).status is BcsdmStatus.OK
    assert dut(far, STRAIGHT, CONFIG).goal_error == pytest.approx(0.0031)


def test_on_the_reference_shortly_before_its_end_is_not_the_goal():
    # 2 mm and 2 cm along the last segment, which takes 0.25 s of the window's 0.5 s.
    there, not_yet = (
        dut(STRAIGHT.positions[-1] - np.array([x, 0, 0]), STRAIGHT, CONFIG) for x in (0.002, 0.02)
    )

    assert there.status is BcsdmStatus.GOAL
    assert not_yet.status is BcsdmStatus.OK
    assert not_yet.mean_error == pytest.approx(0.0, abs=1e-12)


def test_passing_the_end_early_is_not_the_goal():
    there_and_back = np.concatenate([np.linspace(0, 0.1, 11), np.linspace(0.09, 0.0, 10)])
    positions = BODY + there_and_back[:, None, None] * np.array([1.0, 0, 0])
    reference = still_reference(positions, 0.25)
    config = BcsdmConfig(progress_window=(0.5, 0.5), window_escape_ratio=0.0)

    start = dut(BODY, reference, config, previous_tau=0.0)
    end = dut(BODY, reference, config, previous_tau=4.9)

    assert start.status is BcsdmStatus.OK
    assert start.goal_error == pytest.approx(0.0, abs=1e-12)
    assert end.status is BcsdmStatus.GOAL


def test_progress_window_needs_the_last_ticks_time():
    config = BcsdmConfig(progress_window=(0.25, 0.25), window_escape_ratio=0.0)
    points = STRAIGHT.positions[10]

    # The last sample in the window is at 1.25 s, and the closest configuration at the next.
    assert dut(points, STRAIGHT, config, previous_tau=1.0).tau == 1.5
    assert dut(points, STRAIGHT, config, previous_tau=np.nan).tau == 2.5
    # The first is at 1.25 s, and the closest configuration at the one before.
    assert dut(STRAIGHT.positions[2], STRAIGHT, config, previous_tau=1.5).tau == pytest.approx(1.0)


def test_invalid_parameters_are_rejected():
    with pytest.raises(InvalidValueError, match="eta"):
        BcsdmConfig(eta=0.0)
    with pytest.raises(InvalidValueError, match="rigidity, velocity, none"):
        BcsdmConfig(outlier_test="magic")  # type: ignore[arg-type]
