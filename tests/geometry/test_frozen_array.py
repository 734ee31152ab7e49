from dataclasses import dataclass

import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import freeze_fields


@dataclass(frozen=True)
class Track:
    times: np.ndarray
    positions: np.ndarray

    def __post_init__(self):
        freeze_fields(self, times=("T",), positions=("T", 3))


def test_fields_are_read_only_copies():
    times = np.zeros(2)

    dut = Track(times, np.zeros((2, 3)))
    times[0] = 9.0

    assert dut.times.tolist() == [0.0, 0.0]
    assert not dut.times.flags.writeable
    assert not dut.positions.flags.writeable


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (np.zeros((2, 4)), r"Track.positions has shape \(2, 4\), but \(2, 3\) is needed"),
        (np.zeros((5, 3)), r"\(5, 3\), but \(2, 3\)"),
        (np.zeros(3), r"\(3,\)"),
        (np.full((2, 3), np.nan), "holds 6 values that are not finite"),
    ],
)
def test_wrong_fields_are_rejected(positions, message):
    with pytest.raises(InvalidValueError, match=message):
        Track(np.zeros(2), positions)
