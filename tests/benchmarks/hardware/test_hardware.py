import sys
from pathlib import Path

import pytest

from poil_drake.benchmarks.hardware import hardware
from poil_drake.benchmarks.hardware.hardware import HardwareTrial, simulated_driver, summarize
from poil_drake.errors import StationError


def trial(*, success: bool, missed: float, lag: float) -> HardwareTrial:
    figures = {"ticks": 100.0, "missed_ticks": missed, "tick_period_p999_ms": 4.0 + missed}
    return HardwareTrial(
        seed=0,
        success=success,
        reason="",
        hanging_time=0.0,
        run_time=1.0,
        run_figures=figures,
        driver_figures={"ticks": 300.0, "missed_ticks": 3.0},
        largest_lag=lag,
    )


def test_figures_cover_all_trials() -> None:
    summary = summarize(
        [trial(success=True, missed=2.0, lag=0.01), trial(success=False, missed=4.0, lag=0.03)]
    )

    assert summary["trials"] == 2.0
    assert summary["successes"] == 1.0
    assert summary["missed_ticks_of_run"] == pytest.approx(6.0 / 200.0)
    assert summary["missed_ticks_of_driver"] == pytest.approx(0.01)
    assert summary["largest_lag_of_driver_s"] == 0.03
    assert summary["run_tick_period_p999_ms"] == pytest.approx(7.0)


def test_driver_that_does_not_start_is_reported_with_its_last_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = "print('first'); print('no such file'); raise SystemExit(1)"
    monkeypatch.setattr(hardware, "_poil", lambda *arguments: [sys.executable, "-c", code])

    with pytest.raises(StationError, match="did not start: no such file"):
        simulated_driver([], tmp_path).__enter__()
