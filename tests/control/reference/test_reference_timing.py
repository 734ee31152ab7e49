import numpy as np
import pytest

from poil_drake.control.reference.timing import (
    ReferenceConfig,
    RetimingConfig,
    retime,
    split_motion,
)
from poil_drake.errors import InvalidValueError, TransferError

# Fine enough to read speeds off differences of times.
PATH = np.linspace(0.0, 1.0, 2001)


def split(*stretches, twitch=()):
    """Splits the motion of two points at 0.1 m/s in stretches of 30 samples."""
    speeds = np.zeros(30)
    for begin, end in stretches:
        speeds[begin:end] = 0.1
    path = np.cumsum(0.1 * speeds)
    positions = path[:, None, None] * np.array([1.0, 0, 0]) + np.array([[0.0, 0, 0], [0, 1, 0]])
    speeds[list(twitch)] = 0.1
    config = ReferenceConfig(dwell_speed=0.01, min_pause=0.5, min_displacement=0.005)
    return split_motion(0.1 * np.arange(30), speeds, positions, config)


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


def test_constant_speed_takes_distance_over_speed_and_the_ramps():
    config = RetimingConfig(min_speed=0.02, max_speed=0.25, acceleration_time=0.5)

    times = retime(PATH, np.full(2001, 0.1), config)

    # Acceleration 0.1 / 0.5 = 0.2 m/s^2. From 0.02 to 0.1 m/s: 0.4 s over 0.024 m. To rest: 0.5 s
    # over 0.025 m. The rest at 0.1 m/s.
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(0.4 + 0.5 + (1.0 - 0.024 - 0.025) / 0.1, rel=1e-3)


def test_end_is_approached_at_constant_deceleration():
    times = retime(PATH, np.full(2001, 0.1), RetimingConfig(acceleration_time=0.5))

    remaining = times[-1] - times[-30:]
    np.testing.assert_allclose(1.0 - PATH[-30:], 0.5 * 0.2 * remaining**2, atol=1e-12)


def test_speeds_are_scaled_and_kept_within_limits():
    speeds = np.where(PATH < 0.5, 0.001, 0.2)
    config = RetimingConfig(speed_scale=2.0, min_speed=0.05, max_speed=0.3, acceleration_time=0.01)

    times = retime(PATH, speeds, config)

    passed = np.diff(PATH) / np.diff(times)
    assert passed[500] == pytest.approx(0.05)
    assert passed[1500] == pytest.approx(0.3)


@pytest.mark.parametrize(
    "wrong", [{"speed_scale": 0.0}, {"min_speed": 0.3}, {"acceleration_time": 0.0}]
)
def test_inconsistent_limits_are_rejected(wrong):
    with pytest.raises(InvalidValueError, match=next(iter(wrong))):
        RetimingConfig(**wrong)
