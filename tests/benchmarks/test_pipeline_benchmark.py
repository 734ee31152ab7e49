"""The figures over many trials. The trials themselves are whole runs, tested elsewhere."""

import json
import math
from pathlib import Path

import pytest

from poil_drake.benchmarks import pipeline
from poil_drake.benchmarks.pipeline import Trial, summarize
from poil_drake.benchmarks.trials.pool import LostTrial
from poil_drake.errors import InvalidValueError


def hung(seed: int, **changed: object) -> Trial:
    """A trial in which the mug hung."""
    fields: dict = {
        "task": "hang_mug",
        "seed": seed,
        "object_model": "mug_a",
        "success": True,
        "cause": "",
        "final_error": 0.001,
        "tracking_errors": (0.002, 0.004),
        "worst_tracking_error": 0.005,
        "real_time_factor": 1.0,
        "split": {"physics": 0.5, "rendering": 0.5},
        "simulated": 15.0,
    }
    return Trial(**fields | changed)


def unplanned(seed: int, cause: str = "NoFeasibleGraspError: none") -> Trial:
    """A trial that ended before anything was simulated: everything measured is NaN."""
    return Trial(
        task="hang_mug", seed=seed, object_model="mug_b", success=False, cause=cause, split=None
    )


def test_successes_and_causes_are_counted_over_all_trials() -> None:
    trials = [hung(0), unplanned(1), unplanned(2), hung(3, success=False, cause="it fell")]

    dut = summarize(trials)

    assert (dut["trials"], dut["successes"]) == (4, 1)
    assert dut["causes"] == {"NoFeasibleGraspError: none": 2, "it fell": 1}


def test_errors_are_percentiles_of_the_measured_ones() -> None:
    trials = [
        hung(0, final_error=0.001, tracking_errors=(0.001, 0.010)),
        unplanned(1),
        hung(2, final_error=0.002, tracking_errors=(0.002, 0.020)),
        # A failure counts; only figures that were not measured are left out.
        hung(3, final_error=0.009, tracking_errors=(0.006, 0.060), success=False, cause="x"),
        # A run that ended in a fault before the field took over.
        hung(4, final_error=math.nan, tracking_errors=(math.nan, math.nan)),
    ]

    dut = summarize(trials)

    assert dut["final_error_median"] == pytest.approx(0.002)
    assert dut["tracking_error_median"] == pytest.approx(0.002)
    assert dut["tracking_error_median_worst_trial"] == pytest.approx(0.006)
    assert dut["tracking_error_p95_median_trial"] == pytest.approx(0.020)
    assert dut["tracking_error_p95_worst_trial"] == pytest.approx(0.060)


def test_errors_while_carried_and_unobserved_points_have_separate_figures() -> None:
    trials = [
        hung(0, carried_tracking_errors=(0.001, 0.003), unobserved=0.0),
        unplanned(1),
        hung(2, carried_tracking_errors=(0.003, 0.009), unobserved=0.3, carried_unobserved=0.02),
        hung(3, carried_tracking_errors=(0.002, 0.004), unobserved=0.0),
    ]

    dut = summarize(trials)

    assert dut["carried_tracking_error_median"] == pytest.approx(0.002)
    assert dut["carried_tracking_error_p95_median_trial"] == pytest.approx(0.004)
    assert dut["carried_tracking_error_p95_worst_trial"] == pytest.approx(0.009)
    assert dut["unobserved_mean"] == pytest.approx(0.1)
    assert dut["unobserved_worst_trial"] == pytest.approx(0.3)
    assert dut["carried_unobserved_worst_trial"] == pytest.approx(0.02)


def test_speed_has_its_median_and_5th_percentile() -> None:
    # 1.00, 1.01, ..., 1.20: the median is the 11th, and 5 percent are below the second.
    dut = summarize([hung(k, real_time_factor=1.0 + k / 100) for k in range(21)])

    assert dut["real_time_factor_median"] == pytest.approx(1.10)
    assert dut["real_time_factor_p5"] == pytest.approx(1.01)


def test_shares_of_time_are_means_with_0_for_missing_parts() -> None:
    trials = [
        hung(0, split={"physics": 0.75, "rendering": 0.25}),
        hung(1, split={"physics": 0.25, "detection": 0.75}),
        unplanned(2),
    ]

    dut = summarize(trials)["split"]

    assert dut == {"detection": 0.375, "physics": 0.5, "rendering": 0.125}


@pytest.mark.parametrize("trials", [[], [unplanned(0)]], ids=["no trial", "no simulation"])
def test_figures_without_measurements_are_nan(trials: list[Trial]) -> None:
    dut = summarize(trials)

    assert dut["successes"] == 0
    assert dut["split"] == {}
    assert math.isnan(dut["final_error_median"])
    assert math.isnan(dut["real_time_factor_p5"])


def test_file_has_null_for_nan(tmp_path: Path) -> None:
    path = tmp_path / "new" / "bench.json"

    pipeline._write([hung(0), unplanned(1)], path)

    assert "NaN" not in path.read_text()
    read = json.loads(path.read_text())
    assert read["summary"]["trials"] == 2
    assert [trial["final_error"] for trial in read["trials"]] == [0.001, None]
    assert read["trials"][1]["tracking_errors"] == [None, None]


def test_table_shows_errors_in_millimetres_and_all_causes() -> None:
    text = pipeline._table(summarize([hung(0), unplanned(1, cause="it fell")]))

    lines = {line[:36].strip(): line[37:] for line in text.splitlines()}
    assert lines["successes"] == "1"
    assert lines["causes"] == "1 x it fell"
    assert lines["final error median"] == "1.00 mm"
    assert lines["real time factor median"] == "1.00"
    assert lines["split"] == "physics 50%, rendering 50%"


def test_trial_that_fails_before_the_simulation_has_its_cause() -> None:
    trial = pipeline.run_trial({"hang_mug": b"damaged"}, "hang_mug", 3, "ground_truth")

    assert not trial.success
    assert trial.cause.startswith("DemonstrationError: ")
    assert "hang_mug.mcap" in trial.cause
    assert math.isnan(trial.simulated)


def test_trial_that_lost_its_workers_is_a_failure_with_its_cause() -> None:
    lost = LostTrial(3, ("hang_mug", 3, "ground_truth"), 3, "status -11")

    trial = pipeline.lost_trial(lost)

    assert (trial.task, trial.seed, trial.success) == ("hang_mug", 3, False)
    assert "status -11" in trial.cause
    assert trial.object_model.startswith("mug_")


def test_unknown_task_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"'juggle'.*hang_mug"):
        pipeline.run_pipeline_benchmark(
            tasks=["hang_mug", "juggle"],
            trials=1,
            jobs=1,
            tracker=None,
            json_path=tmp_path / "bench.json",
        )
    assert list(tmp_path.iterdir()) == []
