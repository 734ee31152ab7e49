"""Many random trials of `poil run`: success, causes of failure, errors, speed."""

import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from poil_drake.benchmarks.trials.pool import LostTrial, run_trials
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.run.skill_run import ExecutePlan, RecordScenarioDemonstration
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.randomization import ObjectDirective
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import InvalidValueError, PoilError
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.reports.progress import OneLineTqdm
from poil_drake.reports.run_summary import ErrorStatistics

TASKS = {"hang_mug": None}
"""Scenario name by task, in the package's scenario file; None is the default scenario."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """The result of a random run.

    Attributes:
        task: Name of the task.
        seed: Seed of object, pose and noise.
        object_model: Name of the object's model file.
        success: Whether the object hung at the end.
        cause: Cause of the failure; empty on success.
        losses: How often and for how long tracks were lost; empty if never.
        final_error: Mean distance of the points, at release, from the reference's last points [m].
        tracking_errors: Median and 95th percentile of the distance of tracked points from the
            true ones [m]; NaN without tracks.
        worst_tracking_error: Largest distance of a tracked point from the true one [m].
        carried_tracking_errors: `tracking_errors` while the object is carried [m].
        unobserved: Share of the points that the tracker did not observe. Most go unobserved after
            the release, while the object drops and swings.
        carried_unobserved: `unobserved` while the object is carried.
        real_time_factor: Ratio of simulated to wall-clock time of the closed loop.
        split: Shares of the closed loop's wall-clock time, by activity.
        concurrent: Shares of the closed loop's wall-clock time in which another process rendered
            or tracked, by activity.
        simulated: Simulated time [s].
    """

    task: str
    seed: int
    object_model: str
    success: bool = False
    cause: str = ""
    losses: str = ""
    final_error: float = np.nan
    tracking_errors: tuple[float, float] = (np.nan, np.nan)
    worst_tracking_error: float = np.nan
    carried_tracking_errors: tuple[float, float] = (np.nan, np.nan)
    unobserved: float = np.nan
    carried_unobserved: float = np.nan
    real_time_factor: float = np.nan
    split: dict[str, float] | None = None
    concurrent: dict[str, float] | None = None
    simulated: float = np.nan


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
    ends = run_trials(
        run_trial,
        arguments,
        shared=({task: _demonstration(task) for task in tasks},),
        jobs=jobs,
        ray_address=ray_address,
        trials_per_worker=1,
    )
    with closing(ends), OneLineTqdm(total=len(arguments), desc="trials") as bar:
        for index, end in ends:
            results[index] = lost_trial(end) if isinstance(end, LostTrial) else end
            tqdm.write(_row(results[index]))
            bar.update()
            in_order = [results[index] for index in sorted(results)]
            _write(in_order, json_path)
    print(_table(summarize(in_order)))
    return in_order


def run_trial(
    demonstrations: Mapping[str, bytes], task: str, seed: int, tracker: str | None
) -> Trial:
    """Runs one trial, given the contents of each task's demonstration file (MCAP).

    An error becomes the trial's cause of failure.
    """
    scenario, trial = _prepare(task, seed, tracker)
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{task}.mcap"
            path.write_bytes(demonstrations[task])
            plan = PlanScenario(scenario, path)
        summary = ExecutePlan(
            plan, scenario, outputs=OutputPaths(), show=False, show_progress=False, check=False
        )
    except Exception as error:
        problem = error.problem if isinstance(error, PoilError) else " ".join(str(error).split())
        return replace(trial, cause=f"{type(error).__name__}: {problem}")
    timing, nothing = summary.timing, ErrorStatistics.of(np.zeros(0))
    tracking = summary.tracking_error or nothing
    carried = summary.carried_tracking_error or nothing
    return replace(
        trial,
        success=summary.success,
        cause="" if summary.success else summary.reason,
        losses=summary.losses,
        final_error=summary.mean_error,
        tracking_errors=(tracking.median, tracking.percentile_95),
        worst_tracking_error=tracking.maximum,
        carried_tracking_errors=(carried.median, carried.percentile_95),
        unobserved=tracking.missing,
        carried_unobserved=carried.missing,
        real_time_factor=timing.real_time_factor,
        split={name: part / timing.wall for name, part in timing.parts.items()},
        concurrent={name: part / timing.wall for name, part in timing.concurrent.items()},
        simulated=timing.simulated,
    )


def lost_trial(lost: LostTrial) -> Trial:
    """Returns the failed `Trial` that reports a `LostTrial`."""
    _, trial = _prepare(*lost.arguments)
    return replace(trial, cause=str(lost))


def _prepare(task: str, seed: int, tracker: str | None) -> tuple[Scenario, Trial]:
    """Returns the scenario of a trial, and the trial without a result."""
    scenario = ChooseScenario(scenario_name=TASKS[task], seed=seed, tracker=tracker)
    model = Path(ObjectDirective(scenario.directives, scenario.poil.object).file).stem
    return scenario, Trial(task=task, seed=seed, object_model=model)


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
        f"tracking {median:4.1f}/{p95:4.1f} mm rtf {trial.real_time_factor:4.2f} "
        f"{'; '.join(filter(None, (trial.cause, trial.losses)))}"
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
