"""Runs the skill: records a demonstration, plans, executes in closed loop, and reports."""

import dataclasses
import gc
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context

from poil_drake.diagrams.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.demonstration_recorder import RecordDemonstration
from poil_drake.diagrams.dump_scenario import DumpScenario
from poil_drake.diagrams.html_recording import HtmlRecording, MakeMeshcat
from poil_drake.diagrams.plan_fit import CheckPlanFits
from poil_drake.diagrams.planning import PlanScenario
from poil_drake.diagrams.progress import ProgressBar
from poil_drake.diagrams.run_recorder import RunRecorder
from poil_drake.diagrams.run_report import FreshOutputs, OutputPaths, Report, WriteReport
from poil_drake.diagrams.run_summary import RunSummary
from poil_drake.diagrams.scenario import Scenario
from poil_drake.diagrams.scenario_tracker import MakeScenarioTracker
from poil_drake.diagrams.simulator import MakeSimulator
from poil_drake.diagrams.station import MakeStation
from poil_drake.diagrams.task_success import HangingJudge, HolderGeometries
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.registry import make_detector
from poil_drake.recording.run_log import RunLogWriter
from poil_drake.systems.skill_phases import Phase
from poil_drake.systems.snapshot_recorder import SnapshotAlbum
from poil_drake.systems.stopwatch import Stopwatch


def RunSkill(
    scenario: Scenario,
    *,
    outputs: OutputPaths,
    hardware: bool = False,
    show: bool = True,
    realtime_rate: float | None = None,
    demonstration: Path | None = None,
) -> RunSummary:
    """Does the main job: demonstration, transfer, grasp, closed loop.

    Args:
        scenario: The station and the task.
        outputs: Where the outputs go.
        hardware: Whether to drive the real robot.
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
        MakeStation(scenario, hardware=hardware, ignore_output_delay=True)
        if scenario.poil.demonstration is None:
            with stages.measure("demonstration"):
                RecordScenarioDemonstration(scenario, Path(recorded))
        with stages.measure("planning"), ProgressBar() as progress:
            plan = PlanScenario(scenario, recorded, progress=progress)
        return ExecutePlan(
            plan,
            scenario,
            outputs=outputs,
            hardware=hardware,
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
    with FreshOutputs(outputs, scenario, stages, inputs=inputs), ExitStack() as stack:
        if not show:
            outputs = dataclasses.replace(outputs, html=None)
        album = SnapshotAlbum() if outputs.png is not None else None
        meshcat = MakeMeshcat() if show else None
        if meshcat is not None:
            print(f"watch live: {meshcat.web_url()}", flush=True)
        log = None
        if outputs.mcap is not None:
            log = stack.enter_context(_log(outputs.mcap, plan, scenario))
        if check:
            CheckPlanFits(plan, scenario, hardware=hardware)
        with stages.measure("execution"):
            loop = MakeClosedLoop(
                scenario,
                plan,
                meshcat=meshcat,
                hardware=hardware,
                log=log,
                album=album,
                stopwatch=stopwatch,
            )
            stack.callback(loop.Close)
            if meshcat is not None and outputs.html is not None:
                stack.enter_context(_recording(meshcat, outputs.html, scenario))
            recorder = RunRecorder(
                loop=loop,
                query_points=plan.target_points,
                judge=_judge(loop),
            )
            progress = stack.enter_context(ProgressBar(disable=not show_progress))
            report = _simulate(loop, plan, scenario, recorder, stopwatch, realtime_rate, progress)
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
) -> Report:
    simulator = MakeSimulator(loop.diagram, scenario, realtime_rate=realtime_rate)
    root = simulator.get_mutable_context()
    expected = _expected_duration(plan, scenario)
    rates = scenario.poil.rates
    # Imported libraries and the diagram stay; scanning them for garbage again and again is waste.
    gc.collect()
    gc.freeze()
    stopped: BaseException | None = None
    start = time.perf_counter()
    try:
        simulator.Initialize()
        with stopwatch.measure("reporting"):
            recorder.sample(root)
        while recorder.phase < Phase.DONE and root.get_time() < scenario.simulation_duration:
            simulator.AdvanceTo(rates.next_report(root.get_time()))
            with stopwatch.measure("reporting"):
                recorder.sample(root)
            progress("closed loop", min(root.get_time() / expected, 0.99))
    except BaseException as error:  # Also of signals; it goes on once the outputs are written.
        if not recorder.times:
            raise
        stopped = error
    finally:
        gc.unfreeze()
    wall = time.perf_counter() - start
    progress("closed loop", 1.0)
    return Report(
        plan=plan,
        scenario=scenario,
        recorder=recorder,
        fault=recorder.fault(root),
        simulated=root.get_time(),
        wall=wall,
        stopwatch=stopwatch,
        stopped=stopped,
        final_state=_plant_state(loop, root),
    )


def _judge(loop: ClosedLoop) -> HangingJudge:
    station = loop.station
    poil = station.scenario.poil
    holder = HolderGeometries(
        station.plant(),
        station.scene_graph().model_inspector(),
        poil.fixture,
        poil.demonstration_motion.hanging.rod,
    )
    return HangingJudge(fixture=poil.fixture, holder=holder)


def _plant_state(loop: ClosedLoop, root: Context) -> np.ndarray:
    plant = loop.station.plant()
    return plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(root))


def _expected_duration(plan: ExecutionPlan, scenario: Scenario) -> float:
    """Returns about how long a run takes [s], for the progress bar."""
    expected = plan.metadata.get("expected_duration")
    following = float(expected) if isinstance(expected, (int, float)) else 8.0
    return plan.approach.duration + plan.descent.duration + following + 8.0


def _recording(meshcat: Meshcat, path: Path, scenario: Scenario) -> HtmlRecording:
    return HtmlRecording(
        meshcat,
        path,
        title=f"poil_drake: {scenario.poil.object} on {scenario.poil.fixture}",
        frames_per_second=1.0 / scenario.poil.rates.logger,
    )


def _log(path: Path, plan: ExecutionPlan, scenario: Scenario) -> RunLogWriter:
    return RunLogWriter(
        path, metadata=_metadata(plan, scenario), scenario_text=DumpScenario(scenario)
    )


def _metadata(plan: ExecutionPlan, scenario: Scenario) -> dict[str, str]:
    poil = scenario.poil
    return {
        **{key: str(value) for key, value in plan.metadata.items()},
        "scenario": scenario.source.name,
        "scenario_file": scenario.source.file,
        "object": poil.object,
        "part": poil.part,
        "fixture": poil.fixture,
        "tracker": poil.tracker,
        "seed": str(scenario.random_seed),
    }
