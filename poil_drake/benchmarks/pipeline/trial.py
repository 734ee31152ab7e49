"""One random trial of `poil run`."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poil_drake.benchmarks.trials.pool import LostTrial
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.run.skill_run import ExecutePlan
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.randomization import ObjectDirective
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import PoilError
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


def run_trial(
    demonstrations: Mapping[str, bytes], task: str, seed: int, tracker: str | None
) -> Trial:
    """Runs one trial, given the contents of each task's demonstration file (MCAP).

    An error becomes the trial's cause of failure.
    """
    scenario = ChooseScenario(scenario_name=TASKS[task], seed=seed, tracker=tracker)
    model = _object_model(scenario)
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
        cause = f"{type(error).__name__}: {problem}"
        return Trial(task=task, seed=seed, object_model=model, success=False, cause=cause)
    timing, nothing = summary.timing, ErrorStatistics.of(np.zeros(0))
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
        real_time_factor=timing.real_time_factor,
        split={name: part / timing.wall for name, part in timing.parts.items()},
        concurrent={name: part / timing.wall for name, part in timing.concurrent.items()},
        simulated=timing.simulated,
    )


def lost_trial(lost: LostTrial) -> Trial:
    """Returns the failed `Trial` that reports a `LostTrial`."""
    task, seed, tracker = lost.arguments
    model = _object_model(ChooseScenario(scenario_name=TASKS[task], seed=seed, tracker=tracker))
    return Trial(task=task, seed=seed, object_model=model, success=False, cause=str(lost))


def _object_model(scenario: Scenario) -> str:
    return Path(ObjectDirective(scenario.directives, scenario.poil.object).file).stem
