import numpy as np
import pytest

from poil_drake.control.reference.dwell import split_motion
from poil_drake.errors import TransferError


def split(*stretches, twitch=()):
    """Splits the motion of two points at 0.1 m/s in stretches of 30 samples."""
    speeds = np.zeros(30)
    for begin, end in stretches:
        speeds[begin:end] = 0.1
    path = np.cumsum(0.1 * speeds)
    positions = path[:, None, None] * np.array([1.0, 0, 0]) + np.array([[0.0, 0, 0], [0, 1, 0]])
    speeds[list(twitch)] = 0.1
    return split_motion(
        0.1 * np.arange(30),
        speeds,
        positions,
        dwell_speed=0.01,
        min_pause=0.5,
        min_displacement=0.005,
    )


@pytest.mark.parametrize(
    ("stretches", "expected"),
    [
        pytest.param([(5, 12)], [(5, 12)], id="between pauses"),
        pytest.param([(0, 30)], [(0, 30)], id="whole recording"),
        pytest.param([(2, 9), (18, 25)], [(2, 9), (18, 25)], id="long pause"),
        pytest.param([(2, 9), (12, 25)], [(2, 25)], id="short pause"),
    ],
)
def test_motion_is_split_at_long_pauses(stretches, expected):
    assert split(*stretches) == [slice(*stretch) for stretch in expected]


def test_a_twitch_without_displacement_is_not_motion():
    assert split((5, 12), twitch=[20]) == [slice(5, 12)]


def test_a_demonstration_at_rest_is_rejected():
    with pytest.raises(TransferError, match="Nothing moves"):
        split(twitch=[20])
