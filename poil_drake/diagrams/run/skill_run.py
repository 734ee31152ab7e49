"""Runs the skill: records a demonstration, plans, executes in closed loop, and reports."""

import dataclasses
import math
import time
import traceback
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from poil_drake.diagrams.demonstration.recorder import RecordDemonstration
from poil_drake.diagrams.loop.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.loop.scenario_tracker import MakeScenarioTracker
from poil_drake.diagrams.run.html_recording import HtmlRecording, MakeMeshcat
from poil_drake.diagrams.run.open_run_log import OpenRunLog
from poil_drake.diagrams.run.plan_validation import CheckArmStands, CheckPlanFits
from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.run.real_time_loop import (
    QuietInterpreter,
    RealTimeLoop,
    RealTimeLoopConfig,
)
from poil_drake.diagrams.run.recorder import RunRecorder
from poil_drake.diagrams.run.report import FreshOutputs, OutputPaths, Report, WriteReport
from poil_drake.diagrams.run.shutdown import Brake, Resting
from poil_drake.diagrams.run.simulated_truth import SimulatedTruth
from poil_drake.diagrams.run.simulator import MakeSimulator
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.hardware_checks import CheckHardwareRun
from poil_drake.diagrams.station.hardware_schedule import COMMAND_SHARE
from poil_drake.diagrams.station.station import (
    HardwareStation,
    MakeStation,
    RequireLabels,
    SimulatedStation,
)
from poil_drake.errors import PoilError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import make_detector
from poil_drake.recording.run_log.layout import DRY_RUN, HARDWARE, SIMULATED
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.reports.progress import ProgressBar
from poil_drake.reports.run_summary import RunSummary
from poil_drake.runtime.real_time_memory import KeepMemory
from poil_drake.runtime.real_time_scheduling import RealTimeScheduling
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.logging.snapshot_recorder import SnapshotAlbum
from poil_drake.systems.skill.phases import Phase
from poil_drake.systems.skill.stop_requests import StopSwitch
from poil_drake.systems.skill.terminal_stop_key import terminal_stop_key


def RunSkill(
    scenario: Scenario,
    *,
    outputs: OutputPaths,
    hardware: bool = False,
    dry_run: bool = False,
    show: bool = True,
    realtime_rate: float | None = None,
    demonstration: Path | None = None,
) -> RunSummary:
    """Does the main job: demonstration, transfer, grasp, closed loop.

    Args:
        scenario: The station and the task.
        outputs: Where the outputs go.
        hardware: Whether to drive the real robot.
        dry_run: On hardware: whether nothing is sent to the robot, and the motion only shown.
        show: Whether to serve the live page and record it.
        realtime_rate: Slows the simulation down to this rate; 0 runs as fast as it can. None: as
            the scenario's `simulator_config` says.
        demonstration: Where to record the built-in demonstration, if the scenario names none. None:
            beside the outputs.

    Raises:
        PoilError: when there is no plan to execute, which the figures written say, too; a failed
            execution is in the summary.
        BaseException: that stopped it and is no error, e.g. KeyboardInterrupt, after the outputs
            were written.
    """
    stages = Stopwatch()
    recorded = scenario.poil.demonstration
    if recorded is None:
        beside = outputs.json or outputs.mcap or outputs.html or Path("out/run")
        recorded = str(demonstration or beside.parent / "demo.mcap")
    with FreshOutputs(outputs, scenario, stages, inputs=(recorded,)):
        # Mistakes in the scenario show before minutes are spent on a demonstration.
        make_detector(scenario.poil.detector)
        MakeScenarioTracker(scenario.poil)
        if hardware:
            CheckHardwareRun(scenario)
        station = MakeStation(scenario, hardware=hardware, dry_run=True, ignore_output_delay=True)
        RequireLabels(station)
        if hardware:
            with station:
                pass  # A robot or a camera that is not there shows now.
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
    """Records the scenario's built-in demonstration with a progress bar; returns its frames."""
    with ProgressBar() as progress:
        return RecordDemonstration(
            scenario,
            path,
            progress=progress,
        )


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
        plan: What to do.
        scenario: The station and the task.
        outputs: Where the outputs go. They are written even if the run fails or is stopped.
        hardware: Whether to drive the real robot.
        dry_run: On hardware: whether nothing is sent to the robot, and the motion only shown.
        show: Whether to serve the live page and record it.
        realtime_rate: Slows the simulation down to this rate; 0 runs as fast as it can. None: as
            the scenario's `simulator_config` says.
        show_progress: Whether to draw a progress bar.
        stages: How long the stages of the job before this one took.
        check: Whether to look first if the plan fits the scene; there is no need to right after
            it was made.
        inputs: Files that the outputs must not overwrite, such as the plan's.

    Raises:
        PoilError: when the plan does not fit the scene, or the loop cannot be built.
        BaseException: that stopped it and is no error, e.g. KeyboardInterrupt, after the outputs
            were written.
    """
    stopwatch, stages = Stopwatch(), stages or Stopwatch()
    if hardware:
        KeepMemory()
    with FreshOutputs(outputs, scenario, stages, inputs=inputs), ExitStack() as stack:
        if not show:
            outputs = dataclasses.replace(outputs, html=None)
        album = SnapshotAlbum() if outputs.png is not None else None
        meshcat = MakeMeshcat() if show else None
        if meshcat is not None:
            print(f"watch live: {meshcat.web_url()}", flush=True)
        log = None
        if outputs.mcap is not None:
            station = (DRY_RUN if dry_run else HARDWARE) if hardware else SIMULATED
            log = stack.enter_context(
                OpenRunLog(outputs.mcap, plan=plan, scenario=scenario, station=station)
            )
        if check:
            CheckPlanFits(plan, scenario, hardware=hardware)
        with stages.measure("execution"):
            switch = StopSwitch()
            if hardware:
                listening = stack.enter_context(terminal_stop_key(switch))
                keys = "space, Enter, q or Escape" if listening else "no key (no terminal)"
                page = ", the button on the page" if meshcat is not None else ""
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
            if meshcat is not None and outputs.html is not None:
                stack.enter_context(_recording(meshcat, outputs.html, scenario))
            recorder = RunRecorder(
                loop=loop,
                query_points=plan.target_points,
                truth=_truth(loop),
            )
            progress = stack.enter_context(ProgressBar(disable=not show_progress))
            report = _simulate(
                loop, plan, scenario, recorder, stopwatch, realtime_rate, progress, log
            )
            report = dataclasses.replace(report, dry_run=dry_run)
        with stages.measure("report"):
            stack.close()
        summary = WriteReport(report, album=album, outputs=outputs, stages=stages)
        if report.stopped is not None and not isinstance(report.stopped, Exception):
            raise report.stopped
        return summary


def _simulate(
    loop: ClosedLoop,
    plan: ExecutionPlan,
    scenario: Scenario,
    recorder: RunRecorder,
    stopwatch: Stopwatch,
    realtime_rate: float | None,
    progress: ProgressBar,
    log: RunLogWriter | None,
) -> Report:
    if isinstance(loop.station, HardwareStation):
        realtime_rate = 0.0  # Who waits is the loop.
    simulator = MakeSimulator(loop.diagram, scenario, realtime_rate=realtime_rate)
    root = simulator.get_mutable_context()
    expected = _expected_duration(plan, scenario, loop.speed)
    rates = scenario.poil.rates
    pace, clock = _pace(loop, simulator), scenario.poil.hardware.clock()
    advance = simulator.AdvanceTo if pace is None else pace.AdvanceTo
    stopped: BaseException | None = None
    epoch = math.nan
    start = time.perf_counter()
    priority = 0 if pace is None else scenario.poil.hardware.realtime_priority
    try:
        with (
            QuietInterpreter(collecting=pace is None),
            RealTimeScheduling(priority, followers=True),
            Resting(loop.station),
        ):
            simulator.Initialize()
            if pace is not None:
                loop.station.WarmUp()  # What came before all this was built is old.
                CheckArmStands(plan, loop.station)
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
                # Now, as the loop may have fallen behind since; its last tick has just been.
                epoch = clock() - (root.get_time() - rates.control)
            if pace is not None and recorder.phase is Phase.FAULT:
                Brake(loop, root, pace)
    except BaseException as error:  # Also of signals; it goes on once the outputs are written.
        if not recorder.times:
            raise
        if isinstance(error, Exception) and not isinstance(error, PoilError):
            traceback.print_exc()  # The figures say it in one clause only.
        stopped = error
    wall = time.perf_counter() - start
    progress("closed loop", 1.0)
    return Report(
        plan=plan,
        scenario=scenario,
        recorder=recorder,
        fault=recorder.fault(root),
        safety_fault=recorder.safety_fault(root),
        simulated=root.get_time(),
        wall=wall,
        stopwatch=stopwatch,
        stopped=stopped,
        final_state=_plant_state(loop, root),
        problems=_problems(loop, root),
        loop_timing=None if pace is None else pace.timing,
        fault_time=recorder.phase_start(root) if recorder.phase is Phase.FAULT else math.nan,
        epoch=epoch,
    )


def _pace(loop: ClosedLoop, simulator: Simulator) -> RealTimeLoop | None:
    """Returns what advances a loop with a real robot; a simulation needs nothing."""
    station = loop.station
    if not isinstance(station, HardwareStation):
        return None
    return RealTimeLoop(
        simulator,
        period=station.scenario.poil.rates.control,
        config=RealTimeLoopConfig(time_scale=station.config.time_scale, pause=COMMAND_SHARE),
    )


def _problems(loop: ClosedLoop, root: Context) -> tuple[str, ...]:
    """Returns what may have led to a failure, a clause each."""
    supervisor = loop.supervisor
    posture = supervisor.posture_problem(supervisor.GetMyContextFromRoot(root))
    return (*(() if posture is None else (posture,)), *loop.station.Problems())


def _truth(loop: ClosedLoop) -> SimulatedTruth | None:
    station = loop.station
    return SimulatedTruth.of(station) if isinstance(station, SimulatedStation) else None


def _plant_state(loop: ClosedLoop, root: Context) -> np.ndarray:
    """Returns the simulated plant's state; nothing where there is none."""
    if not isinstance(loop.station, SimulatedStation):
        return np.empty(0)
    plant = loop.station.plant()
    return plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(root))


def _expected_duration(plan: ExecutionPlan, scenario: Scenario, speed: float) -> float:
    """Returns about how long a run takes [s], for the progress bar."""
    expected = plan.metadata.get("expected_duration")
    following = float(expected) if isinstance(expected, (int, float)) else 8.0
    return (plan.approach.duration + plan.descent.duration + following) / speed + 8.0


def _recording(meshcat: Meshcat, path: Path, scenario: Scenario) -> HtmlRecording:
    return HtmlRecording(
        meshcat,
        path,
        title=f"poil_drake: {scenario.poil.object} on {scenario.poil.fixture}",
        frames_per_second=1.0 / scenario.poil.rates.logger,
    )
