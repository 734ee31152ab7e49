"""Many random trials of `poil run`: success, causes of failure, errors, speed."""

import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.pipeline.trial import TASKS, Trial, lost_trial, run_trial
from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.diagrams.run.skill_run import RecordScenarioDemonstration
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.reports.progress import OneLineTqdm


def run_pipeline_benchmark(
    *,
    tasks: Sequence[str],
    trials: int,
    jobs: int,
    tracker: str | None,
    json_path: Path,
    ray_address: str | None = None,
) -> list[Trial]:
    """Runs the trials, prints a table and writes all results as JSON.

    Each trial runs in a new process, so that it cannot disturb the next. The trials are returned
    and written in the order of tasks and seeds.

    Args:
        tasks: Names in `TASKS`.
        trials: Number of trials, with seeds 0 to trials - 1.
        jobs: Number of trials that run at the same time; speeds are comparable only with one job.
        tracker: Name of the tracker; None for the scenario's.
        json_path: JSON file for the results, written after every trial.
        ray_address: Address of a Ray cluster, see `run_trials`; None for this machine.

    Raises:
        InvalidValueError: if a task is unknown.
    """
    unknown = sorted(set(tasks) - set(TASKS))
    if unknown:
        raise InvalidValueError(
            f"There is no task '{unknown[0]}'.", remedy=f"Choose from: {', '.join(TASKS)}."
        )
    arguments = [(task, seed, tracker) for task in tasks for seed in range(trials)]
    results: dict[int, Trial] = {}
    in_order: list[Trial] = []
    with (
        closing(
            run_trials(
                run_trial,
                arguments,
                shared=({task: _demonstration(task) for task in tasks},),
                jobs=jobs,
                ray_address=ray_address,
                trials_per_worker=1,
            )
        ) as ends,
        OneLineTqdm(total=len(arguments), desc="trials") as bar,
    ):
        for index, end in ends:
            results[index] = lost_trial(end) if isinstance(end, LostTrial) else end
            tqdm.write(_row(results[index]))
            bar.update()
            in_order = [results[index] for index in sorted(results)]
            _write(in_order, json_path)
    print(_table(summarize(in_order)))
    return in_order


def _demonstration(task: str) -> bytes:
    """Returns the contents of a task's demonstration file, for workers on any machine."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{task}.mcap"
        RecordScenarioDemonstration(ChooseScenario(scenario_name=TASKS[task]), path)
        return path.read_bytes()


def _write(trials: Sequence[Trial], path: Path) -> None:
    write_json({"summary": summarize(trials), "trials": [asdict(one) for one in trials]}, path)


def summarize(trials: Sequence[Trial]) -> dict[str, object]:
    """Returns statistics over all trials, by name.

    Errors are in metres. Trials that raised an error count only in "trials" and "causes".
    """
    finished = [trial for trial in trials if np.isfinite(trial.simulated)]

    def percentile(name: str, percent: float, column: int = 0) -> float:
        values = [np.atleast_1d(getattr(trial, name))[column] for trial in finished]
        return _finite(partial(np.percentile, q=percent), values)

    return {
        "trials": len(trials),
        "successes": sum(trial.success for trial in trials),
        "causes": dict(Counter(trial.cause for trial in trials if not trial.success)),
        "final_error_median": percentile("final_error", 50),
        "tracking_error_median": percentile("tracking_errors", 50),
        "tracking_error_median_worst_trial": percentile("tracking_errors", 100),
        "tracking_error_p95_median_trial": percentile("tracking_errors", 50, 1),
        "tracking_error_p95_worst_trial": percentile("tracking_errors", 100, 1),
        "carried_tracking_error_median": percentile("carried_tracking_errors", 50),
        "carried_tracking_error_p95_median_trial": percentile("carried_tracking_errors", 50, 1),
        "carried_tracking_error_p95_worst_trial": percentile("carried_tracking_errors", 100, 1),
        "unobserved_mean": _finite(np.mean, [trial.unobserved for trial in finished]),
        "unobserved_worst_trial": percentile("unobserved", 100),
        "carried_unobserved_worst_trial": percentile("carried_unobserved", 100),
        "real_time_factor_median": percentile("real_time_factor", 50),
        "real_time_factor_p5": percentile("real_time_factor", 5),
        "split": _mean_shares([trial.split or {} for trial in finished]),
        "concurrent": _mean_shares([trial.concurrent or {} for trial in finished]),
    }


def _mean_shares(shares: Sequence[dict[str, float]]) -> dict[str, float]:
    """Returns the mean of each share; a missing share counts as 0."""
    names = sorted({name for one in shares for name in one})
    return {name: float(np.mean([one.get(name, 0.0) for one in shares])) for name in names}


def _finite(statistic: Callable[..., Any], values: Sequence[float]) -> float:
    """Returns a statistic of the finite values; NaN if there are none."""
    finite = [value for value in values if np.isfinite(value)]
    return float(statistic(finite)) if finite else np.nan


def _row(trial: Trial) -> str:
    median, p95 = (1e3 * error for error in trial.tracking_errors)
    return (
        f"{trial.task} seed {trial.seed:2d} {trial.object_model:10s} "
        f"{'hangs ' if trial.success else 'FAILED'} error {1e3 * trial.final_error:4.1f} mm "
        f"tracking {median:4.1f}/{p95:4.1f} mm rtf {trial.real_time_factor:4.2f} {trial.cause}"
    )


def _table(summary: dict[str, object]) -> str:
    lines = []
    for name, value in summary.items():
        if isinstance(value, float) and "error" in name:
            value = f"{1e3 * value:.2f} mm"
        elif isinstance(value, float) and "unobserved" in name:
            value = f"{value:.1%}"
        elif isinstance(value, float):
            value = f"{value:.2f}"
        elif isinstance(value, dict):
            value = ", ".join(
                f"{key} {item:.0%}" if isinstance(item, float) else f"{item} x {key}"
                for key, item in value.items()
            )
        lines.append(f"{name.replace('_', ' '):36s} {value}")
    return "\n".join(lines)
