import numpy as np
import pytest

from poil_drake.control.reference.dwell import Interval
from poil_drake.control.reference.dwell import split_motion as dut
from poil_drake.errors import InvalidValueError

TIMES = 0.1 * np.arange(30)
LIMITS = {"dwell_speed": 0.01, "min_pause": 0.5, "min_displacement": 0.005}


def moving(*stretches):
    """Speeds and positions of two points that move at 0.1 m/s in the stretches given."""
    speeds = np.zeros(30)
    for begin, end in stretches:
        speeds[begin:end] = 0.1
    path = np.cumsum(0.1 * speeds)
    positions = path[:, None, None] * np.array([1.0, 0, 0]) + np.array([[0.0, 0, 0], [0, 1, 0]])
    return speeds, positions


def split(speeds, positions):
    return dut(TIMES, speeds, positions, **LIMITS)


def test_motion_between_dwells_is_found():
    assert split(*moving((5, 12))) == [Interval(5, 12)]


def test_motion_that_fills_the_recording_is_found():
    assert split(*moving((0, 30))) == [Interval(0, 30)]


def test_pause_splits_the_motion():
    assert split(*moving((2, 9), (18, 25))) == [Interval(2, 9), Interval(18, 25)]


def test_short_pause_is_part_of_the_motion():
    assert split(*moving((2, 9), (12, 25))) == [Interval(2, 25)]


def test_twitch_that_goes_nowhere_is_no_motion():
    speeds, positions = moving((5, 12))
    speeds[20] = 0.1

    assert split(speeds, positions) == [Interval(5, 12)]


def test_standing_still_has_no_motion():
    assert split(*moving()) == []


def test_lengths_must_agree():
    with pytest.raises(InvalidValueError, match="29 speeds"):
        split(np.zeros(29), np.zeros((30, 2, 3)))
