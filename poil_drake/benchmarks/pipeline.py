"""The main job over many randomised trials: success, causes of failure, errors, speed."""

import json
import multiprocessing
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from poil_drake.diagrams.planning import PlanScenario
from poil_drake.diagrams.randomization import ObjectDirective
from poil_drake.diagrams.run_report import OutputPaths
from poil_drake.diagrams.run_summary import ErrorStatistics
from poil_drake.diagrams.scenario_choice import ChooseScenario
from poil_drake.diagrams.skill_run import ExecutePlan, RecordScenarioDemonstration
from poil_drake.errors import InvalidValueError, PoilError
from poil_drake.recording.plain_json import plain_json

TASKS = {"hang_mug": None}
"""Task -> scenario name in the package's scenario file; None is the default."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One randomised run.

    Attributes:
        task: The task.
        seed: Drew object, pose and noise.
        object_model: The object's model file.
        success: Whether the object hung at the end.
        cause: Why it did not; empty on success.
        final_error: Mean distance of the points to the reference's end at release [m].
        tracking_errors: Median and 95th percentile of the distance of tracked points from the
            truth [m]; NaN without tracks.
        worst_tracking_error: The largest of them [m].
        carried_tracking_errors: Median and 95th percentile while the object is carried [m].
        unobserved: Share of the points that the tracker did not see; most are missed after the
            release, while the object drops and swings.
        carried_unobserved: The same while the object is carried.
        real_time_factor: Simulated over wall-clock time of the closed loop.
        split: Share of that wall-clock time by what it went to.
        concurrent: Share of it during which another process rendered or tracked.
        simulated: Simulated time [s].
    """

    task: str
    seed: int
    object_model: str
    success: bool
    cause: str
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
    *, tasks: Sequence[str], trials: int, jobs: int, tracker: str | None, json_path: Path
) -> list[Trial]:
    """Runs the trials, prints a table and writes every figure as JSON.

    Each trial runs in a process of its own, so that none can disturb the next.

    Args:
        tasks: Names in `TASKS`.
        trials: Seeds 0 to trials - 1.
        jobs: Trials run side by side; speeds are only comparable with one.
        tracker: In place of the scenario's.
        json_path: Where the figures go.

    Raises:
        InvalidValueError: if a task is unknown.
    """
    unknown = sorted(set(tasks) - set(TASKS))
    if unknown:
        raise InvalidValueError(
            f"There is no task '{unknown[0]}'.", remedy=f"Choose from: {', '.join(TASKS)}."
        )
    results = []
    with tempfile.TemporaryDirectory() as folder:
        demonstrations = {}
        for task in tasks:
            demonstrations[task] = Path(folder) / f"{task}.mcap"
            RecordScenarioDemonstration(
                ChooseScenario(scenario_name=TASKS[task]), demonstrations[task]
            )
        arguments = [
            (task, seed, tracker, str(demonstrations[task]))
            for task in tasks
            for seed in range(trials)
        ]
        pool = ProcessPoolExecutor(
            jobs, mp_context=multiprocessing.get_context("spawn"), max_tasks_per_child=1
        )
        with pool, tqdm(total=len(arguments), desc="trials") as bar:
            for trial in pool.map(_run_trial, *zip(*arguments, strict=True)):
                results.append(trial)
                tqdm.write(_row(trial))
                bar.update()
                _write(results, json_path)
    print(_table(summarize(results)))
    return results


def _write(trials: Sequence[Trial], path: Path) -> None:
    """Writes what is known so far, so that an interrupted benchmark loses nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figures = {"summary": summarize(trials), "trials": [asdict(trial) for trial in trials]}
    path.write_text(json.dumps(plain_json(figures), indent=2, allow_nan=False))


def summarize(trials: Sequence[Trial]) -> dict[str, object]:
    """Returns the figures over all trials.

    Errors are [m]; percentiles of the trials' own medians and 95th percentiles are given beside
    the largest, so that one bad trial cannot hide.
    """
    finished = [trial for trial in trials if np.isfinite(trial.simulated)]
    medians = [trial.tracking_errors[0] for trial in finished]
    p95s = [trial.tracking_errors[1] for trial in finished]
    carried = np.array([trial.carried_tracking_errors for trial in finished]).reshape(-1, 2)
    factors = [trial.real_time_factor for trial in finished]
    return {
        "trials": len(trials),
        "successes": sum(trial.success for trial in trials),
        "causes": dict(Counter(trial.cause for trial in trials if not trial.success)),
        "final_error_median": _percentile([t.final_error for t in finished], 50),
        "tracking_error_median": _percentile(medians, 50),
        "tracking_error_median_worst_trial": _percentile(medians, 100),
        "tracking_error_p95_median_trial": _percentile(p95s, 50),
        "tracking_error_p95_worst_trial": _percentile(p95s, 100),
        "carried_tracking_error_median": _percentile(carried[:, 0], 50),
        "carried_tracking_error_p95_median_trial": _percentile(carried[:, 1], 50),
        "carried_tracking_error_p95_worst_trial": _percentile(carried[:, 1], 100),
        "unobserved_mean": _mean([trial.unobserved for trial in finished]),
        "unobserved_worst_trial": _percentile([t.unobserved for t in finished], 100),
        "carried_unobserved_worst_trial": _percentile(
            [t.carried_unobserved for t in finished], 100
        ),
        "real_time_factor_median": _percentile(factors, 50),
        "real_time_factor_p5": _percentile(factors, 5),
        "split": _mean_shares([trial.split or {} for trial in finished]),
        "concurrent": _mean_shares([trial.concurrent or {} for trial in finished]),
    }


def _mean_shares(shares: Sequence[dict[str, float]]) -> dict[str, float]:
    """Returns the mean of each share; one that is missing is 0."""
    names = sorted({name for one in shares for name in one})
    return {name: float(np.mean([one.get(name, 0.0) for one in shares])) for name in names}


def _run_trial(task: str, seed: int, tracker: str | None, demonstration: str) -> Trial:
    scenario = ChooseScenario(scenario_name=TASKS[task], seed=seed, tracker=tracker)
    model = Path(ObjectDirective(scenario.directives, scenario.poil.object).file).stem
    try:
        plan = PlanScenario(scenario, demonstration)
        summary = ExecutePlan(
            plan, scenario, outputs=OutputPaths(), show=False, show_progress=False, check=False
        )
    except Exception as error:
        problem = error.problem if isinstance(error, PoilError) else " ".join(str(error).split())
        cause = f"{type(error).__name__}: {problem}"
        return Trial(task=task, seed=seed, object_model=model, success=False, cause=cause)
    nothing = ErrorStatistics.of(np.zeros(0))
    tracking = summary.tracking_error or nothing
    carried = summary.carried_tracking_error or nothing
    return Trial(
        task=task,
        seed=seed,
        object_model=model,
        success=summary.success,
        cause="" if summary.success else summary.reason,
        final_error=summary.mean_error,
        tracking_errors=(tracking.median, tracking.percentile_95),
        worst_tracking_error=tracking.maximum,
        carried_tracking_errors=(carried.median, carried.percentile_95),
        unobserved=tracking.missing,
        carried_unobserved=carried.missing,
        real_time_factor=summary.timing.real_time_factor,
        split=_shares(summary.timing.parts, summary.timing.wall),
        concurrent=_shares(summary.timing.concurrent, summary.timing.wall),
        simulated=summary.timing.simulated,
    )


def _shares(parts: Mapping[str, float], whole: float) -> dict[str, float]:
    """Returns which share of the whole each part is."""
    return {name: part / whole for name, part in parts.items()}


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")


def _percentile(values: Sequence[float] | np.ndarray, percent: float) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.percentile(known, percent)) if known else float("nan")


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
