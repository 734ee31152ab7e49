import numpy as np
import pytest

from poil_drake.runtime.stopwatch import Stopwatch


def test_durations_are_kept_by_name_in_order() -> None:
    dut = Stopwatch()

    for name in ("fast", "slow", "fast"):
        with dut.measure(name):
            pass

    assert dut.durations("fast").shape == (2,)
    assert dut.durations("slow").shape == (1,)
    assert dut.durations("never").shape == (0,)
    assert np.all(dut.durations("fast") >= 0.0)


def test_totals_are_the_sums_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = iter([0.0, 1.0, 10.0, 12.5, 20.0, 24.0])
    monkeypatch.setattr("time.perf_counter", lambda: next(readings))
    dut = Stopwatch()

    for name in ("fast", "slow", "fast"):
        with dut.measure(name):
            pass

    assert dut.totals() == {"fast": 5.0, "slow": 2.5}


def test_work_that_fails_is_counted_too() -> None:
    dut = Stopwatch()

    with pytest.raises(ZeroDivisionError), dut.measure("failing"):
        1 / 0  # noqa: B018

    assert dut.durations("failing").shape == (1,)
