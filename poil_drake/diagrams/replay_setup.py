"""What is to be replayed, and with what: out of a run's log, and what a user wants otherwise."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from poil_drake.diagrams.load_scenario import LoadScenario
from poil_drake.diagrams.replay_station import SPARSE
from poil_drake.diagrams.scenario import Scenario, ScenarioSource
from poil_drake.diagrams.scenario_checks import GROUND_TRUTH
from poil_drake.diagrams.scenario_tracker import MakeScenarioTracker
from poil_drake.errors import PoilError, RunLogError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.plan_file import plan_of
from poil_drake.models.panda_model import ARM_JOINTS
from poil_drake.perception.detectors.registry import LABEL_IMAGE, make_detector
from poil_drake.recording.library_versions import version_metadata
from poil_drake.recording.recorded_run import RecordedRun
from poil_drake.recording.run_log_layout import PLAN_ATTACHMENT, SIMULATED, STATION_KEY
from poil_drake.recording.run_log_reader import load_recorded_run

RECORDED = "recorded"
"""The tracker that repeats the run's own tracks."""


@dataclass(frozen=True, kw_only=True)
class ReplaySetup:
    """What is replayed, and with what.

    Attributes:
        run: The recorded run.
        scenario: The scenario of the replay.
        plan: The plan that was executed.
        tracker: What follows the points: a tracker of images, or `RECORDED`.
        changed: Whether the replay is made with other settings than the run.
        notes: What to know about the log, a clause each.
    """

    run: RecordedRun
    scenario: Scenario
    plan: ExecutionPlan
    tracker: str
    changed: bool
    notes: tuple[str, ...]

    @property
    def station(self) -> str:
        """What executed the plan: `SIMULATED`, `HARDWARE` or `DRY_RUN`."""
        return self.run.metadata.get(STATION_KEY, SIMULATED)


def SetUpReplay(
    path: Path, *, tracker: str | None = None, scenario_text: str | None = None
) -> ReplaySetup:
    """Returns what a replay needs, after checking that the log has it.

    Args:
        path: The log.
        tracker: In place of the run's; None: the run's.
        scenario_text: YAML laid over the run's scenario.

    Raises:
        RunLogError: when the log is missing or damaged, or lacks what is needed.
        PoilError: when there is no such tracker, detector or setting.
    """
    run = load_recorded_run(path, joint_names=ARM_JOINTS)
    _require_contents(run)
    recorded, plan = _recorded_scenario(run), _recorded_plan(run)
    scenario = recorded
    if scenario_text is not None:
        scenario = LoadScenario(data=scenario_text, defaults=recorded)
    used = scenario.poil.tracker if tracker is None else tracker
    if used == GROUND_TRUTH:
        if recorded.poil.tracker != GROUND_TRUTH:
            raise RunLogError(
                f"A log does not hold the truth, which the tracker '{GROUND_TRUTH}' tells.",
                remedy=f"Choose a tracker of images, or '{RECORDED}'.",
            )
        used = RECORDED
    if used != RECORDED:
        scenario = replace(scenario, poil=replace(scenario.poil, tracker=used))
        MakeScenarioTracker(scenario.poil)
        make_detector(scenario.poil.detector)
        _require_images(run, scenario)
    changed = scenario_text is not None or (
        used not in (RECORDED, recorded.poil.tracker) and tracker is not None
    )
    return ReplaySetup(
        run=run,
        scenario=scenario,
        plan=plan,
        tracker=used,
        changed=changed,
        notes=_notes(run, recorded),
    )


def _require_contents(run: RecordedRun) -> None:
    missing = {
        "scenario": run.scenario_text is None,
        f"plan (the attachment '{PLAN_ATTACHMENT}')": run.plan is None,
        "joint states": not len(run.joints),
    }
    for what, lacks in missing.items():
        if lacks:
            why = run.cut_off or "An older version wrote it, or something else than poil run"
            raise RunLogError(
                f"The log '{run.path}' holds no {what}.",
                remedy=f"{why}. Replay a log that poil run or poil execute writes.",
            )


def _recorded_scenario(run: RecordedRun) -> Scenario:
    """Returns the scenario that the run was made with."""
    with tempfile.TemporaryDirectory(prefix="poil_replay_") as folder:
        file = Path(folder) / "scenario.yaml"
        file.write_text(run.scenario_text or "", encoding="utf-8")
        try:
            scenario = LoadScenario(filename=file)
        except PoilError as error:
            problem = error.problem.replace(str(file), "scenario.yaml")
            raise RunLogError(
                f"The scenario in the log '{run.path}' cannot be used: {problem}",
                remedy="Replay it with the version that wrote it.",
            ) from error
    return replace(scenario, source=ScenarioSource(name=scenario.source.name, file=str(run.path)))


def _recorded_plan(run: RecordedRun) -> ExecutionPlan:
    try:
        return plan_of(run.plan or b"", name=f"{run.path}: {PLAN_ATTACHMENT}")
    except PoilError as error:
        raise RunLogError(error.problem, remedy="Copy the log again.") from error


def _require_images(run: RecordedRun, scenario: Scenario) -> None:
    """Checks that the log has what detector and tracker look at."""
    for camera in scenario.cameras:
        images = [image for image in run.images.get(camera, []) if image.depth is not None]
        labelled = any(image.label is not None for image in images)
        kind = "" if not images else "label "
        if not images or (scenario.poil.detector == LABEL_IMAGE and not labelled):
            raise RunLogError(
                f"The log '{run.path}' holds no {kind}images of the camera '{camera}'.",
                remedy=f"Repeat the run's own tracks: --tracker {RECORDED}.",
            )


def _notes(run: RecordedRun, scenario: Scenario) -> tuple[str, ...]:
    """Returns what to know about a log, a clause each."""
    notes = []
    if run.cut_off:
        notes.append(f"the log is cut off, its last sample is of {run.end:.2f} s")
    if run.joints.period > SPARSE * scenario.poil.rates.control:
        notes.append(
            f"the robot's signals were logged every {run.joints.period:g} s only, and are held in "
            "between"
        )
    if dropped := run.metadata.get("dropped_messages"):
        notes.append(f"the log lacks {dropped} messages that its disk was too slow for")
    versions = version_metadata()
    for key in ("poil_drake_version", "drake_version"):
        written = run.metadata.get(key, "")
        if written and written != versions.get(key):
            name = key.removesuffix("_version")
            notes.append(f"written with {name} {written}, replayed with {versions.get(key)}")
    return tuple(notes)
