"""Runs the skill: records a demonstration, plans, executes in closed loop, and reports."""

import dataclasses
import math
import time
import traceback
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context

from poil_drake.diagrams.demonstration.recorder import RecordDemonstration
from poil_drake.diagrams.loop.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.run.finished_run import FinishedRun, WriteReport
from poil_drake.diagrams.run.html_recording import HtmlRecording, MakeMeshcat
from poil_drake.diagrams.run.open_run_log import OpenRunLog
from poil_drake.diagrams.run.output_paths import FreshOutputs, OutputPaths
from poil_drake.diagrams.run.pace_check import pace_warning
from poil_drake.diagrams.run.plan_validation import CheckArmPosition, CheckPlanFits
from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.run.real_time_loop import RealTimeLoop
from poil_drake.diagrams.run.recorder import RunRecorder
from poil_drake.diagrams.run.task_success import SimulatedTruth
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.diagrams.station.hardware.panda_hardware import COMMAND_SHARE
from poil_drake.diagrams.station.station import (
    HardwareStation,
    MakeStation,
    RequireFreeStart,
    RequireLabels,
    SimulatedStation,
)
from poil_drake.diagrams.station.station_base import ground_truth_error
from poil_drake.errors import PoilError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import require_detector
from poil_drake.recording.run_log.layout import DRY_RUN, HARDWARE, SIMULATED
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.reports.progress import ProgressBar
from poil_drake.reports.run_summary import RunSummary
from poil_drake.runtime.real_time import KeepMemory, QuietInterpreter, RealTimeScheduling
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum
from poil_drake.systems.skill.phases import Phase
from poil_drake.systems.skill.stop_requests import StopSwitch, terminal_stop_key

_LONGEST_BRAKING = 1.0
"""Longest wait for the supervisor to bring the arm to rest [s]; it needs less."""


def RunSkill(
    scenario: Scenario,
    *,
    outputs: OutputPaths,
    hardware: bool = False,
    dry_run: bool = False,
    show: bool = True,
    realtime_rate: float | None = None,
) -> RunSummary:
    """Records a demonstration, transfers it, and executes the plan in closed loop.

    If the scenario names no demonstration, one is simulated and recorded beside the outputs.

    Args:
        scenario: The station and the task.
        outputs: Where the outputs go.
        hardware: Whether to drive the real robot.
        dry_run: On hardware: whether to only show the motion, and send nothing to the robot.
        show: Whether to serve the live page and record it.
        realtime_rate: Slows the simulation down to this rate; 0 runs at full speed. None keeps the
            rate of the scenario's `simulator_config`.

    Raises:
        PoilError: if no plan can be made, or if its execution cannot start. The figures state the
            reason, too. A later failure raises no error; the summary states its reason.
        BaseException: if anything but an `Exception` stops the run, e.g. KeyboardInterrupt. The
            outputs are written first.
    """
    stages = Stopwatch()
    recorded = scenario.poil.demonstration
    if recorded is None:
        beside = outputs.json or outputs.mcap or outputs.html or Path("out/run")
        recorded = str(beside.parent / "demo.mcap")
    with FreshOutputs(outputs, scenario, stages, inputs=(recorded,)):
        # Find mistakes in the scenario before minutes are spent on a demonstration.
        require_detector(scenario.poil.detector, scenario.poil.detector_config)
        MakeScenarioTracker(scenario.poil)
        if hardware and scenario.poil.tracker == GROUND_TRUTH:
            raise ground_truth_error()
        station = MakeStation(scenario, hardware=hardware, dry_run=True, ignore_output_delay=True)
        RequireLabels(station)
        RequireFreeStart(station)
        if hardware:
            with station:
                pass  # Raises an error if the robot or a camera is missing.
        if scenario.poil.demonstration is None:
            with stages.measure("demonstration"):
                RecordScenarioDemonstration(scenario, Path(recorded))
        with stages.measure("planning"), ProgressBar() as progress:
            plan = PlanScenario(scenario, recorded, hardware=hardware, progress=progress)
        return ExecutePlan(
            plan,
            scenario,
            outputs=outputs,
            hardware=hardware,
            dry_run=dry_run,
            show=show,
            realtime_rate=realtime_rate,
            stages=stages,
            check=False,
            inputs=(recorded,),
        )


def RecordScenarioDemonstration(scenario: Scenario, path: Path) -> int:
    """Records the built-in demonstration with a progress bar, and returns the number of frames."""
    with ProgressBar() as progress:
        return RecordDemonstration(scenario, path, progress=progress)


def ExecutePlan(
    plan: ExecutionPlan,
    scenario: Scenario,
    *,
    outputs: OutputPaths,
    hardware: bool = False,
    dry_run: bool = False,
    show: bool = True,
    realtime_rate: float | None = None,
    show_progress: bool = True,
    stages: Stopwatch | None = None,
    check: bool = True,
    inputs: Sequence[str | Path | None] = (),
) -> RunSummary:
    """Executes a plan in closed loop, judges the outcome and writes the outputs.

    Args:
        plan: The plan.
        scenario: The station and the task.
        outputs: Where the outputs go. They are written even if the run fails or is stopped.
        hardware: Whether to drive the real robot.
        dry_run: On hardware: whether to only show the motion, and send nothing to the robot.
        show: Whether to serve the live page and record it.
        realtime_rate: Slows the simulation down to this rate; 0 runs at full speed. None keeps the
            rate of the scenario's `simulator_config`.
        show_progress: Whether to draw a progress bar.
        stages: Times of the job's earlier stages.
        check: Whether to check first that the plan fits the scene; not needed right after planning.
        inputs: Files that the outputs must not overwrite, such as the plan's.

    Raises:
        PoilError: if the plan does not fit the scene, or the loop cannot be built.
        BaseException: if anything but an `Exception` stops the run, e.g. KeyboardInterrupt. The
            outputs are written first.
    """
    stopwatch, stages = Stopwatch(), stages or Stopwatch()
    if hardware:
        KeepMemory()
    with FreshOutputs(outputs, scenario, stages, inputs=inputs), ExitStack() as stack:
        meshcat = album = log = None
        if show:
            meshcat = MakeMeshcat()
            print(f"watch live: {meshcat.web_url()}", flush=True)
        else:
            outputs = dataclasses.replace(outputs, html=None)
        if outputs.png is not None:
            album = SnapshotAlbum()
        if outputs.mcap is not None:
            station = (DRY_RUN if dry_run else HARDWARE) if hardware else SIMULATED
            log = stack.enter_context(
                OpenRunLog(outputs.mcap, plan=plan, scenario=scenario, station=station)
            )
        if check:
            CheckPlanFits(plan, scenario, hardware=hardware)
        if hardware and not dry_run and (warning := pace_warning(plan, scenario)):
            print(f"warning: {warning}", flush=True)
        with stages.measure("execution"):
            switch = StopSwitch()
            if hardware:
                listening = stack.enter_context(terminal_stop_key(switch))
                keys = "space, Enter, q or Escape" if listening else "no key (no terminal)"
                page = ", the button on the page" if show else ""
                print(f"what stops the arm: {keys}{page}, Ctrl-C", flush=True)
            loop = MakeClosedLoop(
                scenario,
                plan,
                meshcat=meshcat,
                hardware=hardware,
                dry_run=dry_run,
                log=log,
                album=album,
                stop_switch=switch,
                stopwatch=stopwatch,
            )
            stack.callback(loop.Close)
            truth = None
            if isinstance(loop.station, SimulatedStation):
                truth = SimulatedTruth(loop.station)
            recorder = RunRecorder(loop=loop, query_points=plan.target_points, truth=truth)
            if meshcat is not None and outputs.html is not None:
                recording = HtmlRecording(
                    meshcat,
                    outputs.html,
                    title=f"poil_drake: {scenario.poil.object} on {scenario.poil.fixture}",
                    frames_per_second=1.0 / scenario.poil.rates.logger,
                )
                stack.enter_context(recording)
            progress = stack.enter_context(ProgressBar(disable=not show_progress))
            run = _simulate(plan, scenario, recorder, log, stopwatch, progress, realtime_rate)
            run = dataclasses.replace(run, dry_run=dry_run)
        with stages.measure("report"):
            stack.close()
        summary = WriteReport(run, album=album, outputs=outputs, stages=stages)
        if run.stopped is not None and not isinstance(run.stopped, Exception):
            raise run.stopped
        return summary


def _simulate(
    plan: ExecutionPlan,
    scenario: Scenario,
    recorder: RunRecorder,
    log: RunLogWriter | None,
    stopwatch: Stopwatch,
    progress: ProgressBar,
    realtime_rate: float | None,
) -> FinishedRun:
    """Advances the loop until the skill is done, has failed, or has run out of time."""
    loop, hardware = recorder.loop, scenario.poil.hardware
    station = loop.station
    rates, clock = scenario.poil.rates, hardware.clock()
    simulator = Simulator(loop.diagram)
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    root = simulator.get_mutable_context()
    pace: RealTimeLoop | None = None
    if isinstance(station, HardwareStation):
        simulator.set_target_realtime_rate(0.0)  # `RealTimeLoop` does the pacing.
        pace = RealTimeLoop(
            simulator, period=rates.control, time_scale=hardware.time_scale, pause=COMMAND_SHARE
        )
    elif realtime_rate is not None:
        simulator.set_target_realtime_rate(realtime_rate)
    advance = simulator.AdvanceTo if pace is None else pace.AdvanceTo
    expected = _expected_duration(plan, loop.speed)
    stopped: BaseException | None = None
    epoch, start = math.nan, time.perf_counter()
    try:
        with (
            QuietInterpreter(collecting=pace is None),
            RealTimeScheduling(0 if pace is None else hardware.realtime_priority, followers=True),
            ExitStack() as last,
        ):
            last.callback(station.Rest)  # Before anything else happens, however the loop ends.
            simulator.Initialize()
            if pace is not None:
                station.WarmUp()  # Messages that arrived while the loop was built are old.
                CheckArmPosition(plan, station)
                epoch = clock()
            with stopwatch.measure("reporting"):
                recorder.sample(root)
            while recorder.phase < Phase.DONE and root.get_time() < scenario.simulation_duration:
                advance(rates.next_report(root.get_time()))
                with stopwatch.measure("reporting"):
                    recorder.sample(root)
                if pace is not None and log is not None:
                    log.write_status("/loop/status", pace.timing.latest(), time=root.get_time())
                progress("closed loop", min(root.get_time() / expected, 0.99))
            if pace is not None:
                # Read again after the last tick, because the loop may have fallen behind meanwhile.
                epoch = clock() - (root.get_time() - rates.control)
                if recorder.phase is Phase.FAULT:
                    Brake(loop, root, pace)
    except BaseException as error:  # KeyboardInterrupt, too: `ExecutePlan` raises it again.
        if not recorder.times:
            raise
        if isinstance(error, Exception) and not isinstance(error, PoilError):
            traceback.print_exc()  # The figures hold only one clause of it.
        stopped = error
    wall = time.perf_counter() - start
    progress("closed loop", 1.0)
    supervisor, truth = loop.supervisor, recorder.truth
    posture = supervisor.posture_problem(supervisor.GetMyContextFromRoot(root))
    return FinishedRun(
        plan=plan,
        scenario=scenario,
        recorder=recorder,
        fault=recorder.fault(root),
        safety_fault=recorder.safety_fault(root),
        simulated=root.get_time(),
        wall=wall,
        stopwatch=stopwatch,
        stopped=stopped,
        final_state=np.empty(0) if truth is None else truth.plant_state(root),
        problems=(*(() if posture is None else (posture,)), *station.Problems()),
        loop_timing=None if pace is None else pace.timing,
        fault_time=recorder.phase_start(root) if recorder.phase is Phase.FAULT else math.nan,
        epoch=epoch,
    )


def Brake(loop: ClosedLoop, root: Context, pace: RealTimeLoop) -> None:
    """Advances the loop until the supervisor has brought the arm to rest, for at most 1 s."""
    context = loop.supervisor.GetMyContextFromRoot(root)
    period, end = loop.station.scenario.poil.rates.control, root.get_time() + _LONGEST_BRAKING
    while loop.supervisor.commanded_motion(context).velocity.any() and root.get_time() < end:
        pace.AdvanceTo(root.get_time() + period)


def _expected_duration(plan: ExecutionPlan, speed: float) -> float:
    """Returns the approximate duration of a run [s], for the progress bar."""
    expected = plan.metadata.get("expected_duration")
    following = float(expected) if isinstance(expected, (int, float)) else 8.0
    return (plan.approach.duration + plan.descent.duration + following) / speed + 8.0
