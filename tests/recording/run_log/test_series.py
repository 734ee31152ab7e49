import math

import numpy as np
import pytest

from poil_drake.recording.run_log.recorded_run import Series


def test_the_newest_sample_by_a_time_is_found():
    dut = Series.of([(0.0, [1.0]), (0.25, [2.0]), (0.5, [3.0])], 1)

    found = [dut.at(time)[0] for time in (-0.1, 0.0, 0.2, 0.25, 0.49, 7.0)]

    np.testing.assert_array_equal(found, [np.nan, 1.0, 1.0, 2.0, 2.0, 3.0])


def test_an_empty_series_has_no_sample():
    assert np.isnan(Series.of([], 3).at(0.5)).tolist() == [True] * 3


def test_a_time_that_was_rounded_to_nanoseconds_is_the_same():
    third = round(1e9 / 3) / 1e9

    assert Series.of([(third, [1.0])], 1).at(1 / 3)[0] == 1.0


def test_samples_are_put_in_order():
    dut = Series.of([(0.5, [2.0]), (0.0, [1.0])], 1)

    np.testing.assert_array_equal(dut.times, [0.0, 0.5])
    np.testing.assert_array_equal(dut.values, [[1.0], [2.0]])


@pytest.mark.parametrize(("times", "period"), [([0.0, 0.1, 0.2, 9.0], 0.1), ([1.0], math.nan)])
def test_the_period_is_the_median(times, period):
    dut = Series.of([(time, [0.0]) for time in times], 1)

    assert dut.period == pytest.approx(period, nan_ok=True)
