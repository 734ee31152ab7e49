"""Measures how regularly the loop commands a robot in real time, even with a stalled tracker."""

import dataclasses
import json
import os
import signal
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.benchmarks.hardware.stand_in_robot import (
    StandInSetup,
    running_stand_in,
    with_own_networks,
)
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.run.pace_check import FOLLOWING
from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.run.real_time_loop import LoopTiming, RealTimeLoop
from poil_drake.diagrams.run.skill_run import RecordScenarioDemonstration
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.hardware.panda_hardware import COMMAND_SHARE
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import PoilError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.recording.run_log.writer import RunLogConfig, RunLogWriter
from poil_drake.reports.progress import OneLineTqdm
from poil_drake.runtime.real_time import KeepMemory, QuietInterpreter, RealTimeScheduling
from poil_drake.systems.tracking.point_tracker import PointTracker

_BARE = 10.0
"""Duration of the bare loop, the baseline [s]."""

_WARM_UP = 2.0
"""Time at the start, in which caches and libraries are set up; not measured [s]."""

_HELD_WIDTH = 0.01
_SLOW_RISE = 2e-4  # [m/s]. The reference hardly moves, since the images never change.


@dataclass(frozen=True)
class PeriodRow:
    """The periods of a loop [ms].

    Attributes:
        name: Name of the loop.
        p50: Median period.
        p99: 99th percentile of the period.
        p99_9: 99.9th percentile of the period.
        largest: Largest period.
        jitter_p99_9: 99.9th percentile of the jitter, the distance from the nominal period.
        ratio: Ratio of `jitter_p99_9` to that of the bare loop.
    """

    name: str
    p50: float
    p99: float
    p99_9: float
    largest: float
    jitter_p99_9: float
    ratio: float


def run_hardware_latency_benchmark(*, duration: float, json_path: Path) -> list[PeriodRow]:
    """Runs the loop against a stand-in robot, prints a table and writes it as JSON.

    The loop is the whole hardware path: LCM, cameras, tracker in its process, propagator, field,
    inverse kinematics and log. It stays in the phase `follow`, in which the object follows its
    reference. The stand-in sends 1000 statuses, and eight images of each camera, per second, and
    records the stamps of the commands. The time between two stamps is the measured period. In
    the middle of the run, the tracker's process is stopped for a second. Before the run, a bare
    loop that only waits measures the jitter of the machine itself.

    Args:
        duration: Duration of the run [s].
        json_path: JSON file for the results.

    Raises:
        PoilError: if the loop does not stay in the phase, e.g. because the machine is too slow.
    """
    KeepMemory()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenario = with_own_networks(ChooseScenario())
        plan = _plan(scenario, folder)
        period = scenario.poil.rates.control
        bare = _bare_loop(scenario)
        with running_stand_in(_stand_in_setup(scenario, plan, folder), folder) as robot:
            timing, stalled, end = _run(scenario, plan, folder, duration)
            output, _ = robot.communicate(timeout=60)
        commanded = np.array(json.loads(output.splitlines()[-1])["commanded"])
    # Leaves out the warm-up, and the commands to rest at the end.
    commanded = commanded[(commanded > commanded[0] + _WARM_UP) & (commanded < end)]
    rows = summarize({"bare loop": bare, "commands": commanded}, period)
    ticks = np.array(timing.starts)
    late = np.array(timing.lateness)[(ticks >= stalled[0]) & (ticks <= stalled[1])]
    loop = timing.figures()
    figures = {
        "period_ms": 1e3 * period,
        "duration_s": duration,
        "realtime_priority": scenario.poil.hardware.realtime_priority,
        "missed_ticks": timing.missed,
        "missed_ticks_while_stalled": int((late > period).sum()),
        "rows": [asdict(row) for row in rows],
        "loop": loop,
    }
    write_json(figures, json_path)
    _print_table(rows)
    work = [loop[f"tick_duration_{name}_ms"] for name in ("p50", "p99")]
    print(f"work of a period: p50 {work[0]:.3f} ms, p99 {work[1]:.3f} ms")
    print(
        f"missed ticks: {timing.missed} of {len(ticks)}, "
        f"{figures['missed_ticks_while_stalled']} of {late.size} while the tracker was stalled"
    )
    return rows


def summarize(stamps: dict[str, np.ndarray], period: float) -> list[PeriodRow]:
    """Returns a row for each loop, given its stamps (T,) and nominal period [s].

    The first loop is the baseline of the ratios.
    """
    rows: list[PeriodRow] = []
    for name, times in stamps.items():
        periods = np.diff(times)
        p50, p99, p99_9, largest = (1e3 * np.percentile(periods, [50, 99, 99.9, 100])).tolist()
        jitter = 1e3 * float(np.percentile(np.abs(periods - period), 99.9))
        baseline = rows[0].jitter_p99_9 if rows else jitter
        rows.append(PeriodRow(name, p50, p99, p99_9, largest, jitter, jitter / baseline))
    return rows


def _plan(scenario: Scenario, folder: Path) -> ExecutionPlan:
    """Returns a plan to hang the mug, but with a reference that hardly moves."""
    RecordScenarioDemonstration(scenario, folder / "demo.mcap")
    plan = PlanScenario(scenario, folder / "demo.mcap")
    times = np.linspace(0.0, 1000.0, len(plan.reference.times))
    rise = np.array([0.0, 0.0, _SLOW_RISE])
    positions = plan.target_points + times[:, None, None] * rise
    velocities = np.tile(rise, (len(times), len(plan.target_points), 1))
    velocities[-1] = 0.0
    return dataclasses.replace(plan, reference=PointTrajectory(times, positions, velocities))


def _bare_loop(scenario: Scenario) -> np.ndarray:
    """Returns the start times of the ticks of a loop that only waits [s]."""
    period = scenario.poil.rates.control
    stamps = []
    with QuietInterpreter(), RealTimeScheduling(scenario.poil.hardware.realtime_priority):
        start = time.perf_counter()
        for tick in range(round(_BARE / period)):
            time.sleep(max(0.0, start + tick * period - time.perf_counter()))
            stamps.append(time.perf_counter())
    return np.array(stamps)


def _stand_in_setup(scenario: Scenario, plan: ExecutionPlan, folder: Path) -> StandInSetup:
    with MakeStation(scenario, ignore_output_delay=True) as station:
        frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)
    pictures = {
        f"{camera.name}.{kind}": getattr(image, kind)
        for camera, image in zip(frame.cameras, frame.images, strict=True)
        for kind in ("rgb", "depth", "label")
    }
    np.savez(folder / "pictures.npz", **pictures)
    return StandInSetup(
        robot_url=scenario.lcm_buses["robot"].lcm_url,
        image_url=scenario.lcm_buses["images"].lcm_url,
        position=tuple(plan.approach.positions[0].tolist()),
        holds=_HELD_WIDTH,
        pictures=str(folder / "pictures.npz"),
        cameras=tuple(scenario.cameras),
        image_period=scenario.poil.rates.tracker,
    )


def _run(
    scenario: Scenario, plan: ExecutionPlan, folder: Path, duration: float
) -> tuple[LoopTiming, list[float], float]:
    """Returns the loop's timing, the stall's start and end [s], the run's end [s since epoch]."""
    with RunLogWriter(folder / "run.mcap", config=RunLogConfig(drop_when_full=True)) as log:
        loop = MakeClosedLoop(scenario, plan, hardware=True, log=log)
        assert isinstance(loop.tracker, PointTracker)
        tracker, seconds = loop.tracker.worker_pid, round(duration)
        assert tracker is not None
        stalled: list[float] = []
        try:
            simulator = Simulator(loop.diagram)
            pace = RealTimeLoop(simulator, period=scenario.poil.rates.control, pause=COMMAND_SHARE)
            simulator.Initialize()
            loop.station.WarmUp()
            with (
                QuietInterpreter(),
                RealTimeScheduling(scenario.poil.hardware.realtime_priority, followers=True),
                OneLineTqdm(total=seconds, desc="seconds") as bar,
            ):
                pace.AdvanceTo(_WARM_UP)
                # After the first track, skips grasp and lift.
                context = loop.sequencer.GetMyMutableContextFromRoot(
                    simulator.get_mutable_context()
                )
                context.SetDiscreteState(np.array(FOLLOWING))
                pace.timing = LoopTiming()
                for second in range(seconds):
                    if second in (seconds // 2, seconds // 2 + 1):
                        os.kill(tracker, signal.SIGCONT if stalled else signal.SIGSTOP)
                        stalled.append(time.perf_counter())
                    pace.AdvanceTo(_WARM_UP + second + 1.0)
                    if context.get_discrete_state().value()[0] != FOLLOWING.phase:
                        raise PoilError(
                            "The loop ended with a fault, so it did not do its whole work.",
                            remedy="End other programs and run the benchmark again.",
                        )
                    # While the tracker is stalled, the points do not progress.
                    context.SetDiscreteState(np.array(FOLLOWING))
                    bar.update()
            return pace.timing, stalled, time.time()
        finally:
            loop.Close()


def _print_table(rows: list[PeriodRow]) -> None:
    print(
        f"{'period [ms]':12s} {'p50':>7s} {'p99':>7s} {'p99.9':>7s} {'largest':>8s} "
        f"{'jitter p99.9':>13s}   ratio"
    )
    for row in rows:
        print(
            f"{row.name:12s} {row.p50:7.3f} {row.p99:7.3f} {row.p99_9:7.3f} {row.largest:8.3f} "
            f"{row.jitter_p99_9:13.3f} {row.ratio:7.2f}"
        )
