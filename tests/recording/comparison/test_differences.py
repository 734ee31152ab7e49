import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poil_drake.recording.comparison.differences import SignalPair
from poil_drake.recording.run_log.recorded_run import Series

TIMES = np.array([0.0, 0.1, 0.2, 0.4])


def pair(a, b) -> SignalPair:
    columns = (np.array(values, dtype=float)[:, None] for values in (a, b))
    return SignalPair(TIMES, *columns)


def test_samples_at_the_times_of_both_are_compared() -> None:
    a = Series(np.array([0.0, 0.1, 0.3]), np.array([[1.0], [2.0], [3.0]]))
    b = Series(np.array([0.1, 0.2, 0.3 + 1e-12]), np.array([[5.0], [6.0], [7.0]]))

    dut = SignalPair.of(a, b)

    np.testing.assert_allclose(dut.times, [0.1, 0.3])
    np.testing.assert_array_equal(dut.differences(), [[3.0], [4.0]])


@pytest.mark.parametrize(
    ("shift", "expected"),
    [
        (0.0, [0.0, 1.0, 0.0, 0.0]),
        # At 0.1 s, one is 1 and the other 0; at 0.2 s, both are 1.
        (0.05, [0.0, 1.0, 0.0, 0.0]),
        (0.1, [0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_a_late_signal_counts_by_its_distance_from_the_range(
    shift: float, expected: list[float]
) -> None:
    dut = pair([0.0, 1.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0])

    np.testing.assert_array_equal(dut.differences(shift)[:, 0], expected)


def test_unknown_samples_differ_infinitely_and_bound_nothing() -> None:
    dut = pair([np.nan, np.nan, 1.0, 5.0], [np.nan, 1.0, 1.0, 2.0])

    np.testing.assert_array_equal(dut.differences(0.25)[:, 0], [0.0, np.inf, 0.0, 3.0])


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.5))
@settings(derandomize=True, max_examples=50)
def test_differences_agree_with_a_search_of_each_sample(seed: int, shift: float) -> None:
    random = np.random.default_rng(seed)
    times = np.cumsum(random.uniform(0.01, 0.2, 12))
    a, b = random.normal(size=(2, 12, 2))
    a[random.random((12, 2)) < 0.2] = np.nan

    found = SignalPair(times, a, b).differences(shift)

    def left(x: np.ndarray, y: np.ndarray, row: int, column: int) -> float:
        near = y[np.abs(times - times[row]) <= shift + 1e-9, column]
        near = near[np.isfinite(near)]
        return max(x[row, column] - near.max(), near.min() - x[row, column], 0.0)

    for row in range(12):
        for column in range(2):
            expected = np.inf
            if np.isfinite(a[row, column]):
                expected = max(left(a, b, row, column), left(b, a, row, column))
            assert found[row, column] == pytest.approx(expected)
