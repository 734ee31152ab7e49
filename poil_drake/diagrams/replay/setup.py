"""Sets up a replay from a run's log and the user's changes."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from pydrake.common.yaml import yaml_load

from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.replay.contents import (
    IsSparse,
    NotesOn,
    RequireImages,
    RequireTimes,
    RequireTopics,
    lacking_error,
)
from poil_drake.diagrams.scenario.load import DumpScenario, LoadScenario
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario, ScenarioSource
from poil_drake.errors import PoilError, RunLogError, ScenarioError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import require_detector
from poil_drake.recording.comparison.tolerances import (
    CONTROL_TOLERANCES,
    PERCEPTION_TOLERANCES,
    ReplayTolerances,
)
from poil_drake.recording.run_log.layout import PLAN_ATTACHMENT, SIMULATED, STATION_KEY
from poil_drake.recording.run_log.reader import load_recorded_run
from poil_drake.recording.run_log.recorded_run import RecordedRun

RECORDED = "recorded"
"""Name of the tracker that repeats the run's tracks."""


@dataclass(frozen=True, kw_only=True)
class ReplaySetup:
    """A recorded run, and the settings of its replay.

    Attributes:
        run: The recorded run.
        scenario: The scenario of the replay.
        plan: The plan that was executed.
        tracker: An image-based tracker, or `RECORDED`.
        changed: Whether `scenario_text` was given, or an image-based tracker other than the run's.
        scenario_text: YAML that changes values of the run's scenario, or empty.
        tolerances: The largest differences that count as equal.
        cameras_moved: Whether `scenario_text` changes cameras, or directives that may move cameras.
        notes: Remarks on the log, one clause each.
    """

    run: RecordedRun
    scenario: Scenario
    plan: ExecutionPlan
    tracker: str
    changed: bool
    scenario_text: str
    tolerances: ReplayTolerances
    cameras_moved: bool
    notes: tuple[str, ...]

    @property
    def station(self) -> str:
        """The run's station: `SIMULATED`, `HARDWARE` or `DRY_RUN`."""
        return self.run.metadata.get(STATION_KEY, SIMULATED)


def SetUpReplay(
    path: Path, *, tracker: str | None = None, scenario_text: str | None = None
) -> ReplaySetup:
    """Returns the setup of a replay, after checking that the log is complete.

    Args:
        path: The log.
        tracker: See `Replay`.
        scenario_text: See `Replay`.

    Raises:
        RunLogError: if the log is missing, damaged or incomplete.
        PoilError: if the tracker, the detector or a setting is unknown, or conflicts with the log.
    """
    run = load_recorded_run(path)
    unknown: list[str] = []
    recorded, plan = _recorded_scenario(run, unknown), _recorded_plan(run)
    scenario = recorded
    if scenario_text is not None:
        scenario = LoadScenario(data=scenario_text, defaults=recorded)
        _keep_times(recorded, scenario)
    used = scenario.poil.tracker if tracker is None else tracker
    if used == GROUND_TRUTH:
        if recorded.poil.tracker != GROUND_TRUTH:
            raise RunLogError(
                f"The tracker '{GROUND_TRUTH}' needs simulated poses, which a replay lacks.",
                remedy=f"Choose an image-based tracker or '{RECORDED}'.",
            )
        used = RECORDED
    if used != RECORDED:
        scenario = replace(scenario, poil=replace(scenario.poil, tracker=used))
        MakeScenarioTracker(scenario.poil)
        require_detector(scenario.poil.detector, scenario.poil.detector_config)
        RequireImages(run, scenario)
    RequireTopics(run, repeat_tracks=used == RECORDED)
    RequireTimes(run, recorded)
    changed = scenario_text is not None or (
        used not in (RECORDED, recorded.poil.tracker) and tracker is not None
    )
    notes = NotesOn(run, recorded, repeat_tracks=used == RECORDED)
    if unknown:
        notes += (f"settings that this version lacks were ignored: {', '.join(unknown)}",)
    return ReplaySetup(
        run=run,
        scenario=scenario,
        plan=plan,
        tracker=used,
        changed=changed,
        scenario_text=scenario_text or "",
        tolerances=_tolerances(run, recorded, used),
        cameras_moved=_moves_cameras(recorded, scenario),
        notes=notes,
    )


def _recorded_scenario(run: RecordedRun, unknown: list[str]) -> Scenario:
    """Returns the run's scenario; appends to `unknown` all keys that this version lacks."""
    if run.scenario_text is None:
        raise lacking_error(run, "scenario")
    with tempfile.TemporaryDirectory(prefix="poil_replay_") as folder:
        file = Path(folder) / "scenario.yaml"
        file.write_text(run.scenario_text, encoding="utf-8")
        try:
            scenario = LoadScenario(filename=file, unknown=unknown)
        except PoilError as error:
            problem = error.problem.replace(str(file), "scenario.yaml")
            raise RunLogError(
                f"The scenario in the log '{run.path}' cannot be used: {problem}",
                remedy="Replay the log with the version of poil that wrote it.",
            ) from error
    return replace(scenario, source=ScenarioSource(name=scenario.source.name, file=str(run.path)))


def _recorded_plan(run: RecordedRun) -> ExecutionPlan:
    if run.plan is None:
        raise lacking_error(run, f"plan (attachment '{PLAN_ATTACHMENT}')")
    try:
        return ExecutionPlan.from_bytes(run.plan, name=f"{run.path}: {PLAN_ATTACHMENT}")
    except PoilError as error:
        remedy = "Copy the log again from the original, or record a new run."
        raise RunLogError(error.problem, remedy=remedy) from error


def _tolerances(run: RecordedRun, recorded: Scenario, tracker: str) -> ReplayTolerances:
    """Returns the default tolerances of a replay that uses `tracker`."""
    if tracker == RECORDED:
        return CONTROL_TOLERANCES
    simulated = run.metadata.get(STATION_KEY, SIMULATED) == SIMULATED
    tolerances = PERCEPTION_TOLERANCES.at_speed(1.0 if simulated else recorded.poil.hardware.speed)
    # With missing samples, the signals that the points do not affect differ as well.
    lacking = IsSparse(run, recorded) or "dropped_messages" in run.metadata
    return replace(tolerances, elsewhere=None) if lacking else tolerances


def _keep_times(recorded: Scenario, scenario: Scenario) -> None:
    """Checks that the user did not change settings that determine the times in the log.

    Raises:
        ScenarioError: naming a setting that was changed.
    """
    for key, was in _times(recorded).items():
        wanted = _times(scenario).get(key, was)
        if wanted != was:
            raise ScenarioError(
                f"{key} is {wanted:g} s, but it was {was:g} s in the run: a replay keeps the run's "
                "times.",
                remedy=f"Leave {key} out of --scenario_text.",
            )


def _times(scenario: Scenario) -> dict[str, float]:
    """Returns the settings [s] that determine the times in the log, by their keys."""
    poil = scenario.poil
    return {
        "poil.rates.plant": poil.rates.plant,
        "poil.rates.control": poil.rates.control,
        "poil.rates.tracker": poil.rates.tracker,
        "poil.latency": poil.latency,
        **{f"cameras.{n}.output_delay": c.output_delay for n, c in scenario.cameras.items()},
    }


def _moves_cameras(recorded: Scenario, scenario: Scenario) -> bool:
    """Returns whether the scenarios differ in cameras, or in directives, which may move cameras."""
    nodes = [yaml_load(data=DumpScenario(one, named=False)) for one in (recorded, scenario)]
    return any(nodes[0][key] != nodes[1][key] for key in ("cameras", "directives"))
