"""Replays a recorded run: the same diagram again, with the sensors' messages out of its log."""

import math
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

from pydrake.systems.analysis import Simulator

from poil_drake.diagrams.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.load_scenario import LoadScenario
from poil_drake.diagrams.open_run_log import OpenRunLog
from poil_drake.diagrams.progress import ProgressBar
from poil_drake.diagrams.real_time_loop import QuietInterpreter
from poil_drake.diagrams.replay_picture import ReplayPictureData, make_replay_picture
from poil_drake.diagrams.replay_station import ReplayStation
from poil_drake.diagrams.replay_summary import ReplaySummary
from poil_drake.diagrams.run_report import OutputPaths
from poil_drake.diagrams.scenario import Scenario, ScenarioSource
from poil_drake.diagrams.scenario_checks import GROUND_TRUTH
from poil_drake.diagrams.scenario_tracker import MakeScenarioTracker
from poil_drake.diagrams.simulator import MakeSimulator
from poil_drake.errors import PoilError, RunLogError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.plan_file import plan_of
from poil_drake.models.panda_model import ARM_JOINTS
from poil_drake.perception.detectors.registry import LABEL_IMAGE, make_detector
from poil_drake.recording.library_versions import version_metadata
from poil_drake.recording.recorded_run import RecordedRun, load_recorded_run
from poil_drake.recording.run_comparison import ReplayTolerances, compare_runs
from poil_drake.recording.run_log import RunLogConfig
from poil_drake.recording.run_log_layout import (
    DRY_RUN,
    PLAN_ATTACHMENT,
    SIMULATED,
    STATION_KEY,
    STOPS_TOPIC,
)
from poil_drake.systems.arm_plant import MakePandaKinematics
from poil_drake.systems.stop_requests import StopSwitch

RECORDED = "recorded"
"""The tracker that repeats the run's own tracks."""

CONTROL_TOLERANCES = ReplayTolerances(
    joint_velocity=1e-3,
    angular_velocity=1e-3,
    linear_velocity=1e-4,
    tracked_points=1e-6,
    phase_start=1e-3,
)
"""Where the tracks are repeated, all inputs are the same to the last bit; what is tolerated is
that another processor rounds otherwise, and not another decision."""

PERCEPTION_TOLERANCES = ReplayTolerances(
    joint_velocity=0.25,
    angular_velocity=0.15,
    linear_velocity=0.03,
    tracked_points=0.006,
    phase_start=0.25,
)
"""Where images are tracked again, they are not quite those that were tracked: colours are
compressed, depth is rounded to millimetres. Several times what that makes in the usual run."""

_SPARSE = 1.5
"""Robot signals whose period exceeds that of the control by this factor are too few."""


@dataclass(frozen=True, kw_only=True)
class _Setup:
    """What is replayed, and with what."""

    run: RecordedRun
    scenario: Scenario
    plan: ExecutionPlan
    tracker: str
    changed: bool
    notes: tuple[str, ...]

    @property
    def station(self) -> str:
        return self.run.metadata.get(STATION_KEY, SIMULATED)


def Replay(
    path: str | Path,
    *,
    tracker: str | None = None,
    scenario_text: str | None = None,
    outputs: OutputPaths | None = None,
    tolerances: ReplayTolerances | None = None,
    show_progress: bool = True,
) -> ReplaySummary:
    """Replays a run as fast as it can, and compares what it commanded with what is commanded now.

    The robot's signals are those of the log, whatever is commanded now: differences do not grow
    over time. Perception looks, and answers, when it did in the run.

    Args:
        path: The log of the run, also of one that was killed.
        tracker: In place of the run's: a tracker of images, or `RECORDED`, which repeats the run's
            tracks. None: as the run; the tracks of the simulator's truth are repeated.
        scenario_text: YAML laid over the run's scenario, to see what another setting would do.
        outputs: Where the log, the picture and the figures of the replay go.
        tolerances: What counts as the same; None: `CONTROL_TOLERANCES` where tracks are repeated,
            else `PERCEPTION_TOLERANCES`.
        show_progress: Whether to draw a progress bar.

    Raises:
        RunLogError: when the log is missing or damaged, or lacks what is needed.
        PoilError: when the loop cannot be built with these settings.
    """
    path, outputs = Path(path), outputs or OutputPaths()
    outputs.remove(inputs=(path,))
    setup = _set_up(path, tracker, scenario_text)
    default = CONTROL_TOLERANCES if setup.tracker == RECORDED else PERCEPTION_TOLERANCES
    with tempfile.TemporaryDirectory(prefix="poil_replay_") as folder:
        log = outputs.mcap or Path(folder) / "replay.mcap"
        with ProgressBar(disable=not show_progress) as progress:
            wall = _run(setup, log, images=outputs.mcap is not None, progress=progress)
        replayed = load_recorded_run(log, joint_names=ARM_JOINTS)
    summary = ReplaySummary(
        log=str(path),
        station=setup.station,
        tracker=setup.tracker,
        changed=setup.changed,
        comparison=compare_runs(setup.run, replayed, tolerances or default),
        replayed=setup.run.end,
        wall=wall,
        notes=setup.notes,
        outputs={kind: str(file) for kind, file in vars(outputs).items() if file is not None},
    )
    if outputs.png is not None:
        limits = MakePandaKinematics().velocity_limits
        make_replay_picture(
            outputs.png,
            ReplayPictureData(
                summary=summary, recorded=setup.run, replayed=replayed, velocity_limits=limits
            ),
        )
    if outputs.json is not None:
        summary.write_json(outputs.json)
    return summary


def _set_up(path: Path, tracker: str | None, scenario_text: str | None) -> _Setup:
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
    return _Setup(
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
    if run.joints.period > _SPARSE * scenario.poil.rates.control:
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


def _run(setup: _Setup, log: Path, *, images: bool, progress: ProgressBar) -> float:
    """Simulates the loop over the time of the log, and returns how long that took [s]."""
    switch = StopSwitch()
    station = ReplayStation(setup.scenario, setup.run, repeat_tracks=setup.tracker == RECORDED)
    start = time.perf_counter()
    with (
        OpenRunLog(
            log,
            plan=setup.plan,
            scenario=setup.scenario,
            station=setup.station,
            config=RunLogConfig(images=images),
        ) as writer,
        MakeClosedLoop(
            setup.scenario,
            setup.plan,
            station=station,
            hardware=setup.station != SIMULATED,
            dry_run=setup.station == DRY_RUN,
            log=writer,
            stop_switch=switch,
        ) as loop,
    ):
        simulator = MakeSimulator(loop.diagram, setup.scenario, realtime_rate=0.0)
        with QuietInterpreter(collecting=True):
            _advance(loop, simulator, setup.run, switch, progress)
    progress("replay", 1.0)
    return time.perf_counter() - start


def _advance(
    loop: ClosedLoop,
    simulator: Simulator,
    run: RecordedRun,
    switch: StopSwitch,
    progress: ProgressBar,
) -> None:
    rates = loop.station.scenario.poil.rates
    stops = _stops(run, rates.control)
    simulator.Initialize()
    now = 0.0
    while now < run.end:
        while stops and stops[0] <= now:
            stops.pop(0)
            switch.request()
        boundary = min(rates.next_report(now), run.end, *stops[:1])
        simulator.AdvanceTo(boundary)
        now = simulator.get_context().get_time()
        progress("replay", min(now / run.end, 0.99))


def _stops(run: RecordedRun, period: float) -> list[float]:
    """Returns when stops were asked for [s]: the control ticks that saw them, one for each."""
    series, asked = run.numbers[STOPS_TOPIC], 0.0
    ticks: list[float] = []
    for logged, requests in zip(series.times, series.values[:, 0], strict=True):
        if math.isfinite(requests) and requests > asked:
            tick = (math.ceil(logged / period - 1e-6) - 1) * period
            ticks += [max(tick, 0.0)] * int(min(requests - asked, 1000.0))
            asked = requests
    return ticks
