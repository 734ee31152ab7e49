import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.timestamps import to_nanoseconds, to_seconds


@given(st.integers(0, 10**7))
def test_multiples_of_binary_rates_are_exact(ticks):
    assert to_seconds(to_nanoseconds(ticks / 512)) == ticks / 512


@given(st.integers(0, 2 * 10**9))
def test_nanoseconds_are_exact_both_ways(nanoseconds):
    assert to_nanoseconds(to_seconds(nanoseconds)) == nanoseconds


@pytest.mark.parametrize("time", [-0.1, float("nan"), float("inf")])
def test_times_that_mcap_cannot_hold_are_refused(time):
    with pytest.raises(InvalidValueError, match="not negative"):
        to_nanoseconds(time)
