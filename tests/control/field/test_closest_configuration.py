import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from poil_drake.control.field import closest_configuration as dut
from poil_drake.control.reference.point_trajectory import PointTrajectory

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
# Moves along x by 1 each sample.
POSITIONS = POINTS + np.arange(6.0)[:, None, None] * [1.0, 0, 0]


def make_reference(positions=POSITIONS):
    return PointTrajectory(0.5 * np.arange(len(positions)), positions, np.zeros_like(positions))


def nearest_sample(points, positions, weights=None, **keywords):
    index, fraction = dut.closest_configuration(
        points, make_reference(positions), weights, interpolate=False, **keywords
    )
    assert fraction == 0.0
    return index


def test_squared_distance_adds_up_over_the_points():
    squares = dut.squared_distances(POINTS, POSITIONS)

    np.testing.assert_allclose(squares, 3.0 * np.arange(6) ** 2)


def test_squared_distance_is_weighted():
    moved = POINTS + np.diag([1.0, 2.0, 3.0])

    squares = dut.squared_distances(moved, POSITIONS[:1], np.array([1.0, 0.5, 0.1]))

    np.testing.assert_allclose(squares, [1.0 + 2.0 + 0.9])


def test_nearest_sample_is_the_closest():
    assert nearest_sample(POINTS + np.array([2.4, 0.3, 0]), POSITIONS) == 2
    assert nearest_sample(POINTS + np.array([2.6, 0.3, 0]), POSITIONS, np.ones(3)) == 3


def test_among_equals_the_last_sample_is_taken():
    standing = np.repeat(POSITIONS[:2], 3, axis=0)

    assert nearest_sample(POINTS, standing) == 2
    assert nearest_sample(POINTS + 1.0, standing) == 5


@pytest.mark.parametrize("count", range(2, 12))
def test_equal_samples_are_equally_far_whatever_the_weights(count):
    rng = np.random.default_rng(count)
    standing = np.repeat(rng.normal(size=(1, 10, 3)), count, axis=0)

    squares = dut.squared_distances(
        rng.normal(size=(10, 3)), standing, rng.uniform(0.1, 1.0, size=10)
    )

    assert len(set(squares.tolist())) == 1


def test_closest_configuration_is_between_samples_or_at_one():
    points = POINTS + np.array([2.75, 0.3, 0])

    between = dut.closest_configuration(points, make_reference(), interpolate=True)
    at_sample = dut.closest_configuration(points, make_reference(), interpolate=False)

    assert between == (2, pytest.approx(0.75))
    assert at_sample == (3, 0.0)


@pytest.mark.parametrize(
    ("x", "expected"),
    [(2.25, (2, 0.25)), (1.75, (1, 0.75)), (2.0, (2, 0.0)), (-3.0, (0, 0.0)), (9.0, (5, 0.0))],
)
def test_place_between_samples_of_an_even_motion(x, expected):
    points = POINTS + np.array([x, 0.3, 0.1])
    index = nearest_sample(points, POSITIONS)

    segment, fraction = dut.between_samples(points, make_reference(), index)

    assert segment == expected[0]
    assert fraction == pytest.approx(expected[1])


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=50)
def test_place_between_samples_is_the_best_of_both_segments(seed):
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(size=(3, 4, 3)), axis=0)
    points = positions[1] + rng.normal(size=(4, 3))
    weights = rng.uniform(0.1, 1.0, size=4)

    def squares(place):
        k = min(int(place), 1)
        between = positions[k] + (place - k) * (positions[k + 1] - positions[k])
        return dut.squared_distances(points, between[None], weights)[0]

    found = [minimize_scalar(squares, bounds=b, method="bounded").fun for b in ((0, 1), (1, 2))]

    segment, fraction = dut.between_samples(points, make_reference(positions), 1, weights)

    # The bounded search stops a little short of the bounds.
    assert squares(segment + fraction) == pytest.approx(min(found), rel=1e-4)


def test_repeated_samples_do_no_harm():
    positions = np.repeat(POSITIONS[:1], 3, axis=0)

    assert dut.between_samples(POINTS + 0.1, make_reference(positions), 1) == (1, 0.0)


def nearest_in_window(squares, **keywords):
    """The closest of samples with these squared distances from the points."""
    shifts = np.sqrt(np.array(squares) / 3.0)[:, None, None] * [0.0, 0.0, 1.0]
    return nearest_sample(POINTS, POINTS + shifts, **keywords)


def test_without_window_or_past_the_whole_reference_is_searched():
    squares = [4.0, 3.0, 2.0, 3.0, 2.0, 1.0]

    for window, previous in ((None, 1.0), ((0.5, 0.5), None), ((0.5, 0.5), float("nan"))):
        assert (
            nearest_in_window(squares, previous_tau=previous, window=window, escape_ratio=0.0) == 5
        )


def test_window_keeps_the_index_near_the_last():
    squares = [4.0, 3.0, 2.0, 3.0, 2.0, 1.0]

    assert nearest_in_window(squares, previous_tau=1.0, window=(0.5, 0.5), escape_ratio=0.0) == 2


def test_much_closer_configuration_outside_the_window_wins():
    squares = [4.0, 3.0, 2.0, 3.0, 2.0, 0.1]

    assert nearest_in_window(squares, previous_tau=1.0, window=(0.5, 0.5), escape_ratio=0.25) == 5


def test_window_narrower_than_a_sample_can_still_move_on():
    squares = [4.0, 3.0, 2.0, 1.0, 0.5, 0.1]

    assert nearest_in_window(squares, previous_tau=1.1, window=(0.0, 0.0), escape_ratio=0.0) == 3
    assert nearest_in_window(squares, previous_tau=2.5, window=(0.0, 0.0), escape_ratio=0.0) == 5


def test_window_reaches_as_far_forward_and_backward_as_it_says():
    falling = [4.0, 3.0, 2.0, 1.0, 0.5, 0.1]

    forward = nearest_in_window(falling, previous_tau=0.5, window=(0.0, 1.0), escape_ratio=0.0)
    backward = nearest_in_window(
        falling[::-1], previous_tau=2.0, window=(1.0, 0.0), escape_ratio=0.0
    )

    assert forward == 3
    assert backward == 2


@pytest.mark.parametrize(
    ("previous_tau", "expected"), [(1.1, (2, 4)), (1.0, (2, 4)), (2.5, (5, 6))]
)
def test_narrowest_window_holds_the_samples_beside_the_last_tick(previous_tau, expected):
    times = 0.5 * np.arange(6)

    assert dut.window_samples(times, previous_tau, (0.0, 0.0)) == expected


def test_among_equals_in_the_window_the_last_is_taken():
    # Two samples alike in the window, and two before it of which the first is closer.
    squares = [4.0, 1.0, 5.0, 2.0, 2.0, 4.0]

    assert nearest_in_window(squares, previous_tau=1.5, window=(0.5, 1.0), escape_ratio=0.0) == 4


def test_escape_from_the_window_is_by_weighted_distances():
    # All in place but the first point, which is 1 off; elsewhere only the second is, 0.9.
    positions = np.stack([POINTS] * 4)
    positions[:2, 0, 2] += 1.0
    positions[2:, 1, 2] += 0.9
    keywords = {"previous_tau": 0.0, "window": (0.0, 0.5), "escape_ratio": 0.25}

    alike = nearest_sample(POINTS, positions, **keywords)
    weighted = nearest_sample(POINTS, positions, np.array([1.0, 0.1, 1.0]), **keywords)

    assert alike == 1
    assert weighted == 3


def test_of_two_segments_the_one_that_leads_closer_is_taken_where_its_end_is_closest():
    # Before the sample y falls by 4, after it x grows by 1: up to 3.56 or 4 of squared distance.
    corner = np.array([[0.0, 4.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 9.0]])
    points = POINTS + np.array([2.0, 1.6, 0.0])

    place = dut.between_samples(points, make_reference(POINTS + corner[:, None]), 1)

    assert place == (2, 0.0)
