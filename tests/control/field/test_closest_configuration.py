import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_references import still_reference
from scipy.optimize import minimize_scalar

from poil_drake.control.field import closest_configuration as dut

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
# Moves along x by 1 each sample.
POSITIONS = POINTS + np.arange(6.0)[:, None, None] * [1.0, 0, 0]


def make_reference(positions=POSITIONS):
    return still_reference(positions, 0.5)


def nearest_sample(points, positions, weights=None, **keywords):
    index, fraction = dut.closest_configuration(
        points, make_reference(positions), weights, interpolate=False, **keywords
    )
    assert fraction == 0.0
    return index


def test_squared_distance_is_a_weighted_sum_over_the_points():
    moved = POINTS + np.diag([1.0, 2.0, 3.0])

    squares = dut.squared_distances(POINTS, POSITIONS)
    weighted = dut.squared_distances(moved, POSITIONS[:1], np.array([1.0, 0.5, 0.1]))

    np.testing.assert_allclose(squares, 3.0 * np.arange(6) ** 2)
    np.testing.assert_allclose(weighted, [1.0 + 2.0 + 0.9])


def test_closest_sample_is_the_last_of_equal_ones():
    pausing = np.repeat(POSITIONS[:2], 3, axis=0)

    assert nearest_sample(POINTS + np.array([2.4, 0.3, 0]), POSITIONS) == 2
    assert nearest_sample(POINTS + np.array([2.6, 0.3, 0]), POSITIONS, np.ones(3)) == 3
    assert nearest_sample(POINTS, pausing) == 2
    assert nearest_sample(POINTS + 1.0, pausing) == 5


@pytest.mark.parametrize("count", range(2, 12))
def test_equal_samples_have_equal_squared_distances(count):
    rng = np.random.default_rng(count)
    pausing = np.repeat(rng.normal(size=(1, 10, 3)), count, axis=0)

    squares = dut.squared_distances(
        rng.normal(size=(10, 3)), pausing, rng.uniform(0.1, 1.0, size=10)
    )

    assert len(set(squares.tolist())) == 1


@pytest.mark.parametrize(
    ("x", "expected"),
    [(2.25, (2, 0.25)), (1.75, (1, 0.75)), (2.0, (2, 0.0)), (-3.0, (0, 0.0)), (9.0, (5, 0.0))],
)
def test_interpolation_of_a_constant_motion(x, expected):
    points = POINTS + np.array([x, 0.3, 0.1])

    place = dut.closest_configuration(points, make_reference(), interpolate=True)

    assert place == (expected[0], pytest.approx(expected[1]))


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=50)
def test_interpolation_finds_the_best_of_both_segments(seed):
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


def test_repeated_samples_are_allowed():
    positions = np.repeat(POSITIONS[:1], 3, axis=0)

    assert dut.between_samples(POINTS + 0.1, make_reference(positions), 1) == (1, 0.0)


@pytest.mark.parametrize(
    ("squares", "previous", "window", "escape_ratio", "expected"),
    [
        pytest.param([4, 3, 2, 3, 2, 1], 1.0, None, 0.0, 5, id="no window"),
        pytest.param([4, 3, 2, 3, 2, 1], None, (0.5, 0.5), 0.0, 5, id="no last tick"),
        pytest.param([4, 3, 2, 3, 2, 1], float("nan"), (0.5, 0.5), 0.0, 5, id="lost last tick"),
        pytest.param([4, 3, 2, 3, 2, 1], 1.0, (0.5, 0.5), 0.0, 2, id="near the last tick"),
        pytest.param([4, 3, 2, 3, 2, 0.1], 1.0, (0.5, 0.5), 0.25, 5, id="much closer outside"),
        pytest.param([4, 3, 2, 1, 0.5, 0.1], 0.5, (0.0, 1.0), 0.0, 3, id="forward"),
        pytest.param([0.1, 0.5, 1, 2, 3, 4], 2.0, (1.0, 0.0), 0.0, 2, id="backward"),
        pytest.param([4, 3, 2, 1, 0.5, 0.1], 1.1, (0.0, 0.0), 0.0, 3, id="narrower than a sample"),
        pytest.param([4, 3, 2, 1, 0.5, 0.1], 2.5, (0.0, 0.0), 0.0, 5, id="narrow at the end"),
        # Two equal samples in the window, and two before it of which the first is closer.
        pytest.param([4, 1, 5, 2, 2, 4], 1.5, (0.5, 1.0), 0.0, 4, id="last of equal samples"),
    ],
)
def test_progress_window(squares, previous, window, escape_ratio, expected):
    shifts = np.sqrt(np.array(squares) / 3.0)[:, None, None] * [0.0, 0.0, 1.0]

    index = nearest_sample(
        POINTS, POINTS + shifts, previous_tau=previous, window=window, escape_ratio=escape_ratio
    )

    assert index == expected


@pytest.mark.parametrize(
    ("previous_tau", "expected"), [(1.1, (2, 4)), (1.0, (2, 4)), (2.5, (5, 6))]
)
def test_narrowest_window_holds_the_samples_beside_the_last_tick(previous_tau, expected):
    assert dut.window_samples(0.5 * np.arange(6), previous_tau, (0.0, 0.0)) == expected


def test_escape_from_the_window_is_by_weighted_distances():
    # Two samples where only the first point is off, by 1; two where only the second is, by 0.9.
    positions = np.stack([POINTS] * 4)
    positions[:2, 0, 2] += 1.0
    positions[2:, 1, 2] += 0.9
    keywords = {"previous_tau": 0.0, "window": (0.0, 0.5), "escape_ratio": 0.25}

    alike = nearest_sample(POINTS, positions, **keywords)
    weighted = nearest_sample(POINTS, positions, np.array([1.0, 0.1, 1.0]), **keywords)

    assert alike == 1
    assert weighted == 3


def test_the_closer_of_two_segments_is_used_even_if_its_end_is_closest():
    # Before the sample y falls by 4, after it x grows by 1: up to 3.56 or 4 of squared distance.
    corner = np.array([[0.0, 4.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 9.0]])
    points = POINTS + np.array([2.0, 1.6, 0.0])

    place = dut.between_samples(points, make_reference(POINTS + corner[:, None]), 1)

    assert place == (2, 0.0)
