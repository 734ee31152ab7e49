import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poil_drake.control.field import turn_solve as dut

property_test = settings(derandomize=True, max_examples=200)
seeds = st.integers(0, 2**32 - 1)


def second_moments(arms):
    return tuple((arms.T @ arms)[np.triu_indices(3)].tolist())


def random_arms(rng, scales):
    arms = rng.normal(size=(8, 3)) * scales
    turned = arms @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return turned - turned.mean(axis=0)


@given(seeds, st.floats(0.0, 3.0), st.floats(0.0, 3.0))
@property_test
def test_turn_and_spread_are_those_of_the_decomposition(seed, first, second):
    # From bodies over plates and rods to nearly collinear points.
    rng = np.random.default_rng(seed)
    moments = second_moments(random_arms(rng, [1.0, 10.0**-first, 10.0**-second]))
    moment = tuple(rng.normal(size=3).tolist())

    omega, spread = dut.solve_turn(moments, moment)
    expected_omega, expected_spread = dut.solve_turn_by_axes(moments, moment)

    np.testing.assert_allclose(omega, expected_omega, atol=1e-9 * np.linalg.norm(expected_omega))
    assert spread == pytest.approx(expected_spread, rel=1e-9)


@given(seeds)
@property_test
def test_turn_solves_the_normal_equations(seed):
    rng = np.random.default_rng(seed)
    arms = random_arms(rng, [1.0, 0.5, 0.3])
    W = arms.T @ arms
    moment = rng.normal(size=3)

    omega, _ = dut.solve_turn(second_moments(arms), tuple(moment.tolist()))

    np.testing.assert_allclose((np.trace(W) * np.eye(3) - W) @ omega, moment, atol=1e-11)


@given(seeds, st.floats(0.0, 9.0))
@property_test
def test_largest_eigenvalue_is_exact_up_to_the_rounding_of_the_trace(seed, exponent):
    arms = random_arms(np.random.default_rng(seed), [1.0, 1.0, 10.0**-exponent])
    W = arms.T @ arms

    largest = dut.largest_eigenvalue(second_moments(arms))

    assert largest == pytest.approx(np.linalg.eigvalsh(W)[-1], abs=1e-14 * np.trace(W))


@pytest.mark.parametrize("diagonal", [(2.0, 2.0, 2.0), (0.0, 0.0, 0.0), (1.0, 3.0, 3.0), (3, 1, 1)])
def test_largest_eigenvalue_of_equal_ones(diagonal):
    x, y, z = diagonal

    assert dut.largest_eigenvalue((x, 0.0, 0.0, y, 0.0, z)) == pytest.approx(max(diagonal))


@pytest.mark.parametrize("length", [1e-60, 1.0, 1e60])
def test_collinear_points_of_any_size_get_no_turn_about_their_line(length):
    square = length * length

    omega, spread = dut.solve_turn((square, 0.0, 0.0, 0.0, 0.0, 0.0), (square, square, 0.0))

    assert omega == pytest.approx((0.0, 1.0, 0.0))
    assert spread == 0.0


@given(seeds, st.sampled_from([1e-3, 1.0, 1e6]))
@property_test
def test_collinear_points_in_any_direction_get_no_turn_about_their_line(seed, length):
    rng = np.random.default_rng(seed)
    line = rng.normal(size=3)
    arms = length * np.outer([-1.0, 0.2, 0.8], line)
    omega = rng.normal(size=3)
    moment = np.cross(arms, np.cross(omega, arms)).sum(axis=0)

    found, spread = dut.solve_turn(second_moments(arms), tuple(moment.tolist()))

    across = omega - line * (omega @ line) / (line @ line)
    np.testing.assert_allclose(found, across, atol=1e-9)
    assert spread == pytest.approx(0.0, abs=1e-6 * length)


@pytest.mark.parametrize("size", [1.0, 100.0])
def test_turn_about_an_axis_near_the_points_is_slowed(size):
    # 1 m along x, and 0.1 m off it: well conditioned, but closer than the 0.2 m asked for.
    moments = (size**2, 0.0, 0.0, 0.01 * size**2, 0.0, 0.0)
    moment = (0.01 * size**2, size**2, 1.01 * size**2)

    omega, spread = dut.solve_turn(moments, moment, min_rotation_spread=0.2 * size)

    assert omega == pytest.approx((0.25, 1.0, 1.0))
    assert spread == pytest.approx(0.1 * size)


def test_without_points_there_is_no_turn():
    assert dut.solve_turn((0.0,) * 6, (0.0,) * 3) == ((0.0, 0.0, 0.0), 0.0)
