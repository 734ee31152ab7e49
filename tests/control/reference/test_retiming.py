import numpy as np
import pytest

from poil_drake.control.reference.retiming import RetimingConfig
from poil_drake.control.reference.retiming import retime as dut
from poil_drake.errors import InvalidValueError

# Fine enough to read speeds off differences of times.
PATH = np.linspace(0.0, 1.0, 2001)


def test_constant_speed_takes_distance_over_speed_and_the_ramps():
    config = RetimingConfig(min_speed=0.02, max_speed=0.25, acceleration_time=0.5)

    times = dut(PATH, np.full(2001, 0.1), config)

    # Acceleration 0.1 / 0.5 = 0.2 m/s^2. From 0.02 to 0.1 m/s: 0.4 s over 0.024 m. To rest: 0.5 s
    # over 0.025 m. The rest at 0.1 m/s.
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(0.4 + 0.5 + (1.0 - 0.024 - 0.025) / 0.1, rel=1e-3)


def test_end_is_approached_at_constant_deceleration():
    times = dut(PATH, np.full(2001, 0.1), RetimingConfig(acceleration_time=0.5))

    remaining = times[-1] - times[-30:]
    np.testing.assert_allclose(1.0 - PATH[-30:], 0.5 * 0.2 * remaining**2, atol=1e-12)


def test_speeds_are_scaled_and_kept_within_limits():
    speeds = np.where(PATH < 0.5, 0.001, 0.2)
    config = RetimingConfig(speed_scale=2.0, min_speed=0.05, max_speed=0.3, acceleration_time=0.01)

    times = dut(PATH, speeds, config)

    passed = np.diff(PATH) / np.diff(times)
    assert passed[500] == pytest.approx(0.05)
    assert passed[1500] == pytest.approx(0.3)


@pytest.mark.parametrize(
    "wrong", [{"speed_scale": 0.0}, {"min_speed": 0.3}, {"acceleration_time": 0.0}]
)
def test_inconsistent_limits_are_rejected(wrong):
    with pytest.raises(InvalidValueError, match=next(iter(wrong))):
        RetimingConfig(**wrong)
