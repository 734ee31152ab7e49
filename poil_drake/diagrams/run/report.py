"""What is written when a run is over: figures, one line, one picture."""

import hashlib
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.diagrams.run.real_time_loop import LoopTiming
from poil_drake.diagrams.run.recorder import RunRecorder
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import PoilError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.reports.run_summary import ErrorStatistics, RunSummary, RunTiming, phase_spans
from poil_drake.reports.summary_data import SummaryData
from poil_drake.reports.summary_picture import make_summary_picture
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import PHASE_NAMES, Fault, Phase

__all__ = [
    "REQUIRED_HANGING_TIME",
    "FreshOutputs",
    "OutputPaths",
    "Report",
    "WriteReport",
    "failure_reason",
    "summarize",
]

REQUIRED_HANGING_TIME = 2.0
"""For how long [s, simulated] an object must hang, after release and retreat, to count."""

_MEASURED_PARTS = ("capture", "detection", "waiting", "control", "publishing", "reporting")
"""What one thread does in turn, so that these and what is left add up to the whole."""

_CONCURRENT = ("rendering", "tracking")
"""What other processes do meanwhile."""

_CARRYING = (Phase.LIFT, Phase.FOLLOW)
"""The phases in which the object is carried."""

_PICTURED_PHASES = (
    Phase.WAIT,
    Phase.GRASP,
    Phase.FOLLOW,
    Phase.RELEASE,
    Phase.SETTLE,
)


@dataclass(frozen=True, kw_only=True)
class Report:
    """What is known when a run is over.

    Attributes:
        plan: What was executed.
        scenario: Where.
        recorder: The run's samples.
        fault: Why the skill was given up.
        simulated: Simulated time [s].
        wall: Wall-clock time [s] of the closed loop.
        stopwatch: What that time went to.
        stopped: What ended it before its time: an exception, or somebody; None if nothing did.
        final_state: Positions and velocities of the simulated plant at the end; empty on hardware.
        safety_fault: Why the supervisor stopped the arm.
        dry_run: Whether nothing was sent to a real robot.
        problems: What was wrong with the station's cameras, a sentence each.
        loop_timing: How well the loop kept its pace; None in simulation.
        fault_time: When the fault came [s]; NaN without one.
        epoch: What the station's clock would have shown at the time 0, by the end of the run [s
            since the epoch]; NaN in simulation.
    """

    plan: ExecutionPlan
    scenario: Scenario
    recorder: RunRecorder
    fault: Fault
    simulated: float
    wall: float
    stopwatch: Stopwatch
    stopped: BaseException | None
    final_state: np.ndarray
    safety_fault: SafetyFault = SafetyFault.NONE
    dry_run: bool = False
    problems: Sequence[str] = ()
    loop_timing: LoopTiming | None = None
    fault_time: float = math.nan
    epoch: float = math.nan


@contextmanager
def FreshOutputs(
    outputs: OutputPaths,
    scenario: Scenario,
    stages: Stopwatch,
    *,
    inputs: Sequence[str | Path | None] = (),
) -> Iterator[None]:
    """Removes what an earlier run left; figures are written even if the block raises.

    Where the block ends with an exception before it wrote its own figures, those written here say
    that the job failed, and why. The exception goes on.

    Args:
        outputs: Where the outputs go.
        scenario: What the job is about.
        stages: What the time went to so far.
        inputs: Files that are read and must stay, besides the scenario's and its demonstration.
    """
    outputs.remove(inputs=(scenario.source.file, scenario.poil.demonstration, *inputs))
    try:
        yield
    except BaseException as error:
        if outputs.json is not None and not outputs.json.exists():
            RunSummary(
                success=False,
                reason=failure_reason(error),
                scenario=scenario.source.name,
                scenario_file=scenario.source.file,
                seed=scenario.random_seed,
                tracker=scenario.poil.tracker,
                timing=RunTiming(simulated=0.0, wall=0.0, stages=stages.totals()),
                outputs={"json": str(outputs.json)},
            ).write_json(outputs.json)
        raise


def failure_reason(error: BaseException) -> str:
    """Returns in one clause why a job ended with an exception."""
    if isinstance(error, PoilError):
        return error.problem.rstrip(".")
    text = " ".join(str(error).split())
    if not isinstance(error, Exception):  # A signal's, such as KeyboardInterrupt.
        return text or "stopped by the user"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def WriteReport(
    report: Report,
    *,
    outputs: OutputPaths,
    album: SnapshotAlbum | None = None,
    stages: Stopwatch | None = None,
) -> RunSummary:
    """Judges a run and writes its picture and its figures.

    Args:
        report: What is known.
        outputs: Where the outputs go, or went.
        album: Pictures of the run.
        stages: How long each stage of the job took; "report" is added.
    """
    stages = stages or Stopwatch()
    summary = summarize(report, outputs)
    try:
        with stages.measure("report"):
            if outputs.png is not None:
                make_summary_picture(outputs.png, _picture_data(report, summary, album))
    finally:
        # Last, as it says how long the rest took; in any case, as nothing matters more.
        timing = replace(summary.timing, stages=stages.totals())
        summary = replace(summary, timing=timing)
        if outputs.json is not None:
            summary.write_json(outputs.json)
    return summary


def summarize(report: Report, outputs: OutputPaths | None = None) -> RunSummary:
    """Returns what a run came to; of the outputs, those that are left out are not named."""
    recorder = report.recorder
    success, reason = _judge(report)
    error, potential = recorder.signal("goal_error"), recorder.signal("potential")
    following = recorder.signal("phase") == Phase.FOLLOW
    stamps, errors = recorder.tracking_errors()
    carried = np.isin(_phases_at(recorder, stamps), _CARRYING)
    held = error[following] if following.any() else np.full(1, np.nan)
    driven = potential[following] if following.any() else np.full(1, np.nan)
    written = {} if outputs is None else vars(outputs)
    return RunSummary(
        success=success,
        reason=reason,
        scenario=report.scenario.source.name,
        scenario_file=report.scenario.source.file,
        seed=report.scenario.random_seed,
        timing=_timing(report),
        phases=phase_spans(np.array(recorder.times), recorder.signal("phase"), PHASE_NAMES),
        mean_error=float(held[-1]),
        initial_potential=float(driven[0]),
        final_potential=float(driven[-1]),
        tracking_error=ErrorStatistics.of(errors),
        carried_tracking_error=ErrorStatistics.of(errors[carried]),
        outputs={kind: str(path) for kind, path in written.items() if path is not None},
        tracker=report.scenario.poil.tracker,
        final_state_digest=_digest(report.final_state),
        figures=_figures(report),
    )


def _digest(state: np.ndarray) -> str:
    return hashlib.sha256(state.tobytes()).hexdigest() if state.size else ""


def _figures(report: Report) -> dict[str, float]:
    judge = report.recorder.judge
    figures = {} if judge is None else {"hanging_time_s": judge.hanging_time(report.simulated)}
    times = {"fault_time_s": report.fault_time, "epoch_s": report.epoch}
    figures |= {name: time for name, time in times.items() if math.isfinite(time)}
    return figures | ({} if report.loop_timing is None else report.loop_timing.figures())


def _phases_at(recorder: RunRecorder, times: np.ndarray) -> np.ndarray:
    """Returns the phases (S,) at some times (S,) [s]: of the last sample by then."""
    index = np.searchsorted(recorder.times, times, side="right") - 1
    return recorder.signal("phase")[np.maximum(index, 0)]


def _judge(report: Report) -> tuple[bool, str]:
    poil, judge = report.scenario.poil, report.recorder.judge
    if report.stopped is not None:
        return False, failure_reason(report.stopped)
    # The sequencer no longer looks once it is done; the supervisor does.
    safety = report.safety_fault is not SafetyFault.NONE
    if report.fault is not Fault.NONE or safety:
        reason = report.fault.text
        if safety and report.fault in (Fault.NONE, Fault.SAFETY):
            reason = report.safety_fault.text
        return False, _with_problems(f"{reason} (in phase '{_last_phase(report)}')", report)
    if report.recorder.phase is not Phase.DONE:
        phase = report.recorder.phase.name.lower()
        return False, _with_problems(f"the time was up in phase '{phase}'", report)
    if report.dry_run:
        return True, "the whole motion was shown; nothing was sent to the robot"
    if judge is None:
        return True, f"the {poil.object} was left at the goal and let go; nobody judged if it hangs"
    hung = judge.hanging_time(report.simulated)
    if hung >= REQUIRED_HANGING_TIME:
        return True, f"the {poil.object} hangs on the {poil.fixture} (for {hung:.1f} s so far)"
    touched = ", ".join(sorted(judge.touched_links)) or "nothing"
    return False, f"the {poil.object} does not hang on the {poil.fixture}: it touches {touched}"


def _with_problems(reason: str, report: Report) -> str:
    return "; ".join([reason, *report.problems])


def _last_phase(report: Report) -> str:
    """Returns the phase in which the fault came."""
    phases = [phase for phase in report.recorder.signal("phase") if phase != Phase.FAULT]
    return Phase(int(phases[-1])).name.lower() if phases else "wait"


def _timing(report: Report) -> RunTiming:
    measured = report.stopwatch.totals()
    parts = {name: measured.get(name, 0.0) for name in _MEASURED_PARTS}
    # What is left is what Drake does between: physics, contact, and finding the next events.
    parts["physics"] = max(report.wall - sum(parts.values()), 0.0)
    return RunTiming(
        simulated=report.simulated,
        wall=report.wall,
        parts=parts,
        concurrent={name: measured.get(name, 0.0) for name in _CONCURRENT},
    )


def _picture_data(report: Report, summary: RunSummary, album: SnapshotAlbum | None) -> SummaryData:
    recorder = report.recorder
    points = recorder.signal("points").reshape(len(recorder.times), -1, 3)
    targets = recorder.signal("target_points").reshape(points.shape)
    stamps, errors = recorder.tracking_errors()
    starts = [
        span.start
        for span in summary.phases
        if span.name in {p.name.lower() for p in _PICTURED_PHASES}
    ]
    limits = PandaModel().velocity
    timing = summary.timing
    return SummaryData(
        title=f"{report.scenario.poil.object} on {report.scenario.poil.fixture}",
        success=summary.success,
        reason=summary.reason,
        subtitle=(
            f"tracker {report.scenario.poil.tracker}, {timing.simulated:.1f} s simulated at "
            f"{timing.real_time_factor:.2f} x real time"
        ),
        times=np.array(recorder.times),
        point_errors=np.linalg.norm(points - targets, axis=2),
        potential=recorder.signal("potential"),
        tau=recorder.signal("tau"),
        reference_duration=float(report.plan.reference.times[-1]),
        joint_velocities=recorder.signal("joint_velocities"),
        velocity_limits=limits,
        phases=summary.phases,
        tracking_times=stamps,
        tracking_errors=errors,
        snapshots=() if album is None else album.nearest_to([*starts, report.simulated]),
    )
