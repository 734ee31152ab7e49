import math

import pytest

from poil_drake.diagrams.scenario.poil_config import Rates
from poil_drake.errors import ScenarioError


@pytest.mark.parametrize(
    ("periods", "says"),
    [
        ({"control": 1 / 300}, "control is"),
        # 50 times 0.002 is 0.1 in print only: the floating-point numbers drift apart.
        ({"plant": 0.002, "control": 0.002, "tracker": 0.1, "logger": 0.002}, "tracker is"),
        ({"logger": 1 / 512}, "logger is"),
        ({"plant": 0.0}, "plant is"),
        ({"control": math.inf}, "control is inf"),
        ({"logger": math.nan}, "logger is nan"),
        ({"tracker": -1 / 8}, "tracker is"),
    ],
)
def test_periods_that_do_not_divide_are_refused(periods: dict[str, float], says: str) -> None:
    with pytest.raises(ScenarioError, match=f"poil.rates.{says}"):
        Rates(**periods)


def test_a_report_follows_every_log_and_every_capture() -> None:
    dut = Rates(tracker=3 / 32, logger=1 / 16)

    times = [0.0]
    while times[-1] < 0.25:
        times.append(dut.next_report(times[-1]))

    assert times == [0.0, 2 / 32, 3 / 32, 4 / 32, 6 / 32, 8 / 32]


def test_reports_do_not_drift_from_captures() -> None:
    # 0.02 is not exact in binary: adding it up misses whole multiples from the third on.
    dut = Rates(plant=0.005, control=0.005, tracker=0.08, logger=0.02)

    time, times = 0.0, set()
    for _ in range(4000):
        time = dut.next_report(time)
        times.add(time)

    assert len(times) == 4000
    assert {k * 0.08 for k in range(1, 1000)} <= times
