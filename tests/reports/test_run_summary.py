import json
import math

import numpy as np
import pytest

from poil_drake.reports.run_summary import (
    ErrorStatistics,
    PhaseSpan,
    RunSummary,
    RunTiming,
    phase_spans,
)

TIMING = RunTiming(simulated=20.0, wall=16.0, parts={"rendering": 8.0})


def test_statistics_use_the_finite_errors():
    # 0, 1, ..., 100 mm: the median is 50 and 95 percent do not exceed 95.
    errors = np.r_[np.nan, np.arange(101) * 1e-3, np.nan]

    dut = ErrorStatistics.of(errors)

    assert dut.count == 101
    assert dut.median == pytest.approx(0.050)
    assert dut.percentile_95 == pytest.approx(0.095)
    assert dut.maximum == dut.final == pytest.approx(0.100)
    assert dut.missing == pytest.approx(2 / 103)


def test_statistics_without_finite_errors_are_nan():
    dut = ErrorStatistics.of(np.full((3, 2), np.nan))

    assert (dut.count, dut.missing) == (0, 1.0)
    assert math.isnan(dut.median)
    assert ErrorStatistics.of(np.zeros(0)).missing == 0.0


def test_real_time_factor():
    assert TIMING.real_time_factor == pytest.approx(1.25)
    assert math.isnan(RunTiming(simulated=0.0, wall=0.0).real_time_factor)


def test_phase_spans_of_sampled_indices():
    times = np.arange(6) * 0.5

    dut = phase_spans(times, np.array([0, 0, 1, 1, 1, 3.0]), ["wait", "go", "stay", "done"])

    assert dut == (
        PhaseSpan(name="wait", start=0.0, end=1.0),
        PhaseSpan(name="go", start=1.0, end=2.5),
        PhaseSpan(name="done", start=2.5, end=2.5),
    )
    assert phase_spans(np.zeros(0), np.zeros(0), []) == ()


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        (
            {"mean_error": 0.00183, "tracking_error": ErrorStatistics.of(np.array([0.0024]))},
            "SUCCESS: it hangs; mean point error 1.8 mm; tracking error 2.4 mm (median); "
            "20.0 s simulated in 16.0 s (1.25x real time).",
        ),
        (
            {"figures": {"epoch_s": 1e9}},
            "SUCCESS: it hangs; 20.0 s passed in 16.0 s (1.25x real time).",
        ),
        (
            {"success": False, "timing": RunTiming(simulated=0.0, wall=0.0)},
            "FAILURE: it hangs.",
        ),
    ],
)
def test_the_closing_line_has_the_known_figures(fields, line):
    values = {"success": True, "reason": "it hangs", "timing": TIMING}

    assert RunSummary(**values | fields).closing_line() == line


def test_json_holds_every_figure_and_no_nan(tmp_path):
    dut = RunSummary(
        success=True,
        reason="it hangs",
        scenario="HangMug",
        seed=3,
        timing=TIMING,
        phases=(PhaseSpan(name="wait", start=0.0, end=1.0),),
        final_potential=np.float64(1e-6),
        outputs={"html": "out/run.html"},
        figures={"hanging_time [s]": 2.0},
    )

    text = dut.write_json(tmp_path / "new" / "run.json").read_text()

    assert "NaN" not in text
    read = json.loads(text)
    assert read["success"] is True
    assert read["seed"] == 3
    assert read["mean_error"] is None
    assert read["final_potential"] == 1e-6
    assert read["tracking_error"] is None
    assert read["phases"] == [{"name": "wait", "start": 0.0, "end": 1.0}]
    assert read["timing"]["real_time_factor"] == 1.25
    assert read["timing"]["parts"] == {"rendering": 8.0}
    assert read["outputs"] == {"html": "out/run.html"}
    assert read["figures"] == {"hanging_time [s]": 2.0}
    assert read["versions"]["drake"]
