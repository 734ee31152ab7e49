import pytest

from poil_drake.runtime.stopwatch import Stopwatch


def test_durations_are_kept_by_name_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = iter([0.0, 1.0, 10.0, 12.5, 20.0, 24.0])
    monkeypatch.setattr("time.perf_counter", lambda: next(readings))
    dut = Stopwatch()

    for name in ("fast", "slow", "fast"):
        with dut.measure(name):
            pass

    assert dut.durations("fast").tolist() == [1.0, 4.0]
    assert dut.durations("never").shape == (0,)
    assert dut.totals() == {"fast": 5.0, "slow": 2.5}


def test_failing_work_is_measured_too() -> None:
    dut = Stopwatch()

    with pytest.raises(ZeroDivisionError), dut.measure("failing"):
        1 / 0  # noqa: B018

    assert dut.durations("failing").shape == (1,)
