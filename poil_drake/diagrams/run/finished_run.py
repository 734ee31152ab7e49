"""Judges a finished run, and writes its figures and its picture."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poil_drake.diagrams.run.output_paths import OutputPaths, failure_reason
from poil_drake.diagrams.run.real_time_loop import LoopTiming
from poil_drake.diagrams.run.recorder import RunRecorder
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.reports.run_summary import ErrorStatistics, RunSummary, RunTiming, phase_spans
from poil_drake.reports.summary_panels import SummaryData
from poil_drake.reports.summary_picture import make_summary_picture
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import PHASE_NAMES, Fault, Phase

REQUIRED_HANGING_TIME = 2.0
"""How long [s, simulated] the object must have hung at the end of a run for the run to succeed."""

_MEASURED_PARTS = ("capture", "detection", "waiting", "control", "publishing", "reporting")
"""Kinds of work that the simulation's thread does in turn. The rest of its time is physics."""

_CONCURRENT = ("rendering", "tracking")
"""Kinds of work that other processes do at the same time."""

_CARRYING = (Phase.LIFT, Phase.FOLLOW)
"""The phases in which the object is carried."""

_PICTURED_PHASES = (Phase.WAIT, Phase.GRASP, Phase.FOLLOW, Phase.RELEASE, Phase.SETTLE)


@dataclass(frozen=True, kw_only=True)
class FinishedRun:
    """What the report needs to know about a run that has ended.

    Attributes:
        plan: The plan that was executed.
        scenario: The scenario of the run.
        recorder: The run's samples.
        fault: The fault that the sequencer reported.
        simulated: Simulated time [s].
        wall: Wall-clock time [s] of the closed loop.
        stopwatch: How the wall-clock time was spent.
        stopped: The exception that ended the run early, such as KeyboardInterrupt; else None.
        final_state: Positions and velocities of the simulated plant at the end; empty on hardware.
        safety_fault: The fault that the supervisor reported.
        dry_run: Whether a hardware run sent nothing to the robot.
        problems: Problems of the arm and cameras that may explain a failure, one clause each.
        loop_timing: How well the loop kept its pace; None in simulation.
        fault_time: When the fault occurred [s]; NaN without a fault.
        epoch: Time of `HardwareConfig.clock` when the loop's time was 0 [s], computed from both
            clocks at the end of the run; NaN in simulation.
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


def WriteReport(
    run: FinishedRun,
    *,
    outputs: OutputPaths,
    album: SnapshotAlbum | None = None,
    stages: Stopwatch,
) -> RunSummary:
    """Judges a run, writes its picture and its figures, and returns the summary.

    Args:
        run: The run.
        outputs: Paths of the picture and the figures, and of what the run has already written.
        album: Camera pictures of the run; None shows none in the picture.
        stages: Times of the job's stages so far; the stage "report" is added.
    """
    summary = summarize(run, outputs)
    try:
        with stages.measure("report"):
            if outputs.png is not None:
                make_summary_picture(outputs.png, _picture_data(run, summary, album))
    finally:
        # Last, because the figures include the time that the picture takes, even if it fails.
        timing = replace(summary.timing, stages=stages.totals())
        summary = replace(summary, timing=timing)
        if outputs.json is not None:
            summary.write_json(outputs.json)
    return summary


def summarize(run: FinishedRun, outputs: OutputPaths) -> RunSummary:
    """Returns the summary of a run, with the paths of its outputs."""
    recorder, scenario = run.recorder, run.scenario
    success, reason = _judge(run)
    error, potential = recorder.signal("goal_error"), recorder.signal("potential")
    phases = recorder.signal("phase")
    following = phases == Phase.FOLLOW
    if not following.any():
        error, potential, following = np.full(1, np.nan), np.full(1, np.nan), np.array([True])
    stamps, errors = recorder.tracking_errors()
    # The phase at a stamp is that of the last sample by then.
    sample = np.maximum(np.searchsorted(recorder.times, stamps, side="right") - 1, 0)
    carried = np.isin(phases[sample], _CARRYING)
    state = run.final_state
    return RunSummary(
        success=success,
        reason=reason,
        losses=recorder.tracking_losses().clause(),
        scenario=scenario.source.name,
        scenario_file=scenario.source.file,
        seed=scenario.random_seed,
        timing=_timing(run),
        phases=phase_spans(np.array(recorder.times), phases, PHASE_NAMES),
        mean_error=float(error[following][-1]),
        initial_potential=float(potential[following][0]),
        final_potential=float(potential[following][-1]),
        tracking_error=ErrorStatistics.of(errors),
        carried_tracking_error=ErrorStatistics.of(errors[carried]),
        outputs={kind: str(path) for kind, path in outputs.as_dict().items()},
        tracker=scenario.poil.tracker,
        final_state_digest=hashlib.sha256(state.tobytes()).hexdigest() if state.size else "",
        figures=_figures(run),
    )


def _figures(run: FinishedRun) -> dict[str, float]:
    judge, timing = run.recorder.judge, run.loop_timing
    times = {"fault_time_s": run.fault_time, "epoch_s": run.epoch}
    return {
        **({} if judge is None else {"hanging_time_s": judge.hanging_time(run.simulated)}),
        **run.recorder.tracking_losses().figures(),
        **{name: time for name, time in times.items() if math.isfinite(time)},
        **({} if timing is None else timing.figures()),
    }


def _judge(run: FinishedRun) -> tuple[bool, str]:
    """Returns whether the task succeeded, and the reason for this verdict."""
    poil, judge, phase = run.scenario.poil, run.recorder.judge, run.recorder.phase
    if run.stopped is not None:
        return False, failure_reason(run.stopped)
    # The supervisor can still find a fault after the sequencer is done.
    safety = run.safety_fault is not SafetyFault.NONE
    if run.fault is not Fault.NONE or safety:
        reason = run.fault.text
        if safety and run.fault in (Fault.NONE, Fault.SAFETY):
            reason = run.safety_fault.text
        return False, "; ".join([f"{reason} (in phase '{_last_phase(run)}')", *run.problems])
    if phase is not Phase.DONE:
        reason = f"the time ran out in phase '{phase.name.lower()}'"
        return False, "; ".join([reason, *run.problems])
    if run.dry_run:
        return True, "the whole motion was shown; nothing was sent to the robot"
    if judge is None:
        return True, f"the {poil.object} was released at the goal; nothing checked that it hangs"
    hung = judge.hanging_time(run.simulated)
    if hung >= REQUIRED_HANGING_TIME:
        return True, f"the {poil.object} hangs on the {poil.fixture} (for {hung:.1f} s so far)"
    touched = ", ".join(sorted(judge.touched_links)) or "nothing"
    return False, f"the {poil.object} does not hang on the {poil.fixture}: it touches {touched}"


def _last_phase(run: FinishedRun) -> str:
    """Returns the name of the phase in which the fault occurred."""
    phases = [phase for phase in run.recorder.signal("phase") if phase != Phase.FAULT]
    return Phase(int(phases[-1])).name.lower() if phases else "wait"


def _timing(run: FinishedRun) -> RunTiming:
    measured = run.stopwatch.totals()
    parts = {name: measured.get(name, 0.0) for name in _MEASURED_PARTS}
    # The rest is Drake's: physics, contact, and finding the next events.
    parts["physics"] = max(run.wall - sum(parts.values()), 0.0)
    return RunTiming(
        simulated=run.simulated,
        wall=run.wall,
        parts=parts,
        concurrent={name: measured.get(name, 0.0) for name in _CONCURRENT},
    )


def _picture_data(
    run: FinishedRun, summary: RunSummary, album: SnapshotAlbum | None
) -> SummaryData:
    recorder, poil, timing = run.recorder, run.scenario.poil, summary.timing
    points = recorder.signal("points").reshape(len(recorder.times), -1, 3)
    targets = recorder.signal("target_points").reshape(points.shape)
    stamps, errors = recorder.tracking_errors()
    pictured = {phase.name.lower() for phase in _PICTURED_PHASES}
    losses = f", {summary.losses}" if summary.losses else ""
    starts = [span.start for span in summary.phases if span.name in pictured]
    return SummaryData(
        title=f"{poil.object} on {poil.fixture}",
        success=summary.success,
        reason=summary.reason,
        subtitle=(
            f"tracker {poil.tracker}, {timing.simulated:.1f} s simulated at "
            f"{timing.real_time_factor:.2f} x real time{losses}"
        ),
        times=np.array(recorder.times),
        point_errors=np.linalg.norm(points - targets, axis=2),
        potential=recorder.signal("potential"),
        tau=recorder.signal("tau"),
        reference_duration=float(run.plan.reference.times[-1]),
        joint_velocities=recorder.signal("joint_velocities"),
        velocity_limits=PandaModel().velocity,
        phases=summary.phases,
        tracking_times=stamps,
        tracking_errors=errors,
        snapshots=() if album is None else album.nearest_to([*starts, run.simulated]),
    )
