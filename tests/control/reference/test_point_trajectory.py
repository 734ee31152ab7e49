import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from point_references import seeds, still_reference
from scipy.optimize import minimize_scalar

from poil_drake.control.reference.point_trajectory import PointTrajectory, closest_configuration
from poil_drake.errors import InvalidValueError

START = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
TURNED = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])


def make_trajectory(**changed) -> PointTrajectory:
    values = {
        "times": np.array([0.0, 1.0, 3.0]),
        "positions": np.stack([START, TURNED, TURNED]),
        "velocities": np.zeros((3, 2, 3)),
    }
    return PointTrajectory(**(values | changed))


@pytest.mark.parametrize(
    ("time", "second_point"),
    [
        (-1.0, [1.0, 0.0, 0.0]),
        (0.0, [1.0, 0.0, 0.0]),
        (0.25, [0.75, 0.5, 0.0]),
        (1.0, [0.0, 2.0, 0.0]),
        (2.0, [0.0, 2.0, 0.0]),
        (3.0, [0.0, 2.0, 0.0]),
        (9.0, [0.0, 2.0, 0.0]),
    ],
)
def test_positions_are_linear_between_samples_and_clamped_outside(
    time: float, second_point: list[float]
) -> None:
    positions = make_trajectory().positions_at(time)

    np.testing.assert_allclose(positions, [[0.0, 0.0, 0.0], second_point], atol=1e-15)


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("times", np.array([0.0, 1.0, 1.0]), "two times that increase from 0"),
        ("times", np.array([0.5, 1.0, 3.0]), "two times that increase from 0"),
        ("positions", np.zeros((2, 2, 3)), r"positions has shape \(2, 2, 3\)"),
        ("positions", np.full((3, 2, 3), np.nan), "not finite"),
        ("velocities", np.zeros((3, 3, 3)), r"velocities has shape \(3, 3, 3\)"),
        ("velocities", np.ones((3, 2, 3)), "last sample .* not zero"),
    ],
)
def test_invalid_trajectories_are_rejected(field: str, value: np.ndarray, says: str) -> None:
    with pytest.raises(InvalidValueError, match=says):
        make_trajectory(**{field: value})


POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
EVEN = np.full(3, 1.0 / 3.0)
# Moves along x by 1 each sample.
POSITIONS = POINTS + np.arange(6.0)[:, None, None] * [1.0, 0, 0]


def make_reference(positions=POSITIONS):
    return still_reference(positions, 0.5)


def shares_of(weights):
    return np.asarray(weights) / np.sum(weights)


def nearest_sample(points, positions, weights=(1.0, 1.0, 1.0), **keywords):
    return closest_configuration(
        points, make_reference(positions), shares_of(weights), interpolate=False, **keywords
    )


def test_closest_sample_is_the_last_of_equal_ones():
    pausing = np.repeat(POSITIONS[:2], 3, axis=0)

    assert nearest_sample(POINTS + np.array([2.4, 0.3, 0]), POSITIONS) == 2
    assert nearest_sample(POINTS + np.array([2.6, 0.3, 0]), POSITIONS) == 3
    assert nearest_sample(POINTS, pausing) == 2
    assert nearest_sample(POINTS + 1.0, pausing) == 5


@given(seeds, st.sampled_from([0.0, 1.0, 10.0]))
@settings(derandomize=True, max_examples=50)
def test_of_many_equal_samples_the_last_is_found_for_many_states_at_once(seed, distance):
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(scale=0.01, size=(20, 5, 3)), axis=0) + distance
    # There and back.
    positions = np.concatenate([walk, walk[::-1]])
    shares = rng.uniform(0.1, 1.0, size=(20, 5))
    shares /= shares.sum(axis=1, keepdims=True)

    found = closest_configuration(walk, still_reference(positions), shares, interpolate=False)

    np.testing.assert_array_equal(found, 39 - np.arange(20))


@pytest.mark.parametrize(
    ("x", "expected"),
    [(2.25, 2.25), (1.75, 1.75), (2.0, 2.0), (-3.0, 0.0), (9.0, 5.0)],
)
def test_interpolation_of_a_constant_motion(x, expected):
    points = POINTS + np.array([x, 0.3, 0.1])

    assert closest_configuration(points, make_reference(), EVEN, interpolate=True) == pytest.approx(
        expected
    )


@given(seeds)
@settings(derandomize=True, max_examples=50)
def test_interpolation_finds_the_best_of_both_segments(seed):
    rng = np.random.default_rng(seed)
    # The ends are so far away that the middle sample is the closest of the three.
    positions = rng.normal(size=(3, 4, 3)) * np.array([1.0, 0.1, 1.0])[:, None, None]
    points = positions[1] + rng.normal(scale=0.3, size=(4, 3))
    shares = shares_of(rng.uniform(0.1, 1.0, size=4))

    def squares(place):
        k = min(int(place), 1)
        between = positions[k] + (place - k) * (positions[k + 1] - positions[k])
        return shares @ np.sum((points - between) ** 2, axis=1)

    assume(min(squares(0), squares(2)) > squares(1))
    found = [minimize_scalar(squares, bounds=b, method="bounded").fun for b in ((0, 1), (1, 2))]

    place = closest_configuration(points, make_reference(positions), shares, interpolate=True)

    # The bounded search stops a little short of the bounds.
    assert squares(float(place)) == pytest.approx(min(found), rel=1e-4)


def test_repeated_samples_are_allowed():
    positions = np.repeat(POSITIONS[:1], 3, axis=0)

    assert (
        closest_configuration(POINTS + 0.1, make_reference(positions), EVEN, interpolate=True)
        == 2.0
    )


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
    ("previous_tau", "expected"), [(1.1, (2, 3)), (1.0, (2, 3)), (2.5, (5, 5)), (-0.1, (0, 1))]
)
def test_narrowest_window_holds_the_samples_beside_the_last_tick(previous_tau, expected):
    window = {"previous_tau": previous_tau, "window": (0.0, 0.0)}

    found = [
        nearest_sample(POINTS + np.array([x, 0.0, 0.0]), POSITIONS, **window) for x in (-9.0, 9.0)
    ]

    assert found == list(expected)


def test_each_state_has_its_own_window():
    points = np.stack([POINTS] * 3)
    shares = np.stack([EVEN] * 3)

    found = closest_configuration(
        points,
        make_reference(),
        shares,
        interpolate=False,
        window=(0.5, 0.5),
        previous_tau=np.array([1.0, np.nan, 2.0]),
    )

    assert found.tolist() == [1.0, 0.0, 3.0]


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
