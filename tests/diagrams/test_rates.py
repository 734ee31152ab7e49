import pytest

from poil_drake.diagrams.rates import Rates
from poil_drake.errors import ScenarioError


def test_the_defaults_divide_one_another() -> None:
    dut = Rates()

    assert (dut.plant, dut.control, dut.tracker, dut.logger) == (1 / 512, 1 / 256, 1 / 8, 1 / 32)


@pytest.mark.parametrize(
    ("periods", "says"),
    [
        ({"control": 1 / 300}, "'control'"),
        # 50 times 0.002 is 0.1 in print only: the floating-point numbers drift apart.
        ({"plant": 0.002, "control": 0.002, "tracker": 0.1, "logger": 0.002}, "'tracker'"),
        ({"logger": 1 / 512}, "'logger'"),
        ({"plant": 0.0}, "'control'"),
        ({"tracker": -1 / 8}, "'tracker'"),
    ],
)
def test_periods_that_do_not_divide_are_refused(periods: dict[str, float], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        Rates(**periods)
