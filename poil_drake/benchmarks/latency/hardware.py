"""How evenly the loop commands a robot in real time, also while its tracker is stalled."""

import dataclasses
import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
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
from poil_drake.diagrams.loop.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.run.real_time_loop import LoopTiming, RealTimeLoop
from poil_drake.diagrams.run.skill_run import RecordScenarioDemonstration
from poil_drake.diagrams.scenario.choice import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.hardware.hardware_schedule import COMMAND_SHARE
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import StationError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.recording.run_log.writer import RunLogConfig, RunLogWriter
from poil_drake.reports.progress import OneLineTqdm
from poil_drake.runtime.real_time import KeepMemory, QuietInterpreter, RealTimeScheduling
from poil_drake.systems.skill.phases import Phase
from poil_drake.systems.skill.state_machine import SkillState
from poil_drake.systems.tracking.point_tracker import PointTracker

_STALL = 1.0
"""How long the tracker's process is stopped, in the middle of the run [s]."""

_BARE = 10.0
"""How long the bare loop runs that all is compared with [s]."""

_WARM_UP = 2.0
"""What is not counted: caches and libraries are set up then [s]."""

_HELD_WIDTH = 0.01
_SLOW_RISE = 2e-4  # [m/s]: the reference hardly moves, as the pictures do not at all.


@dataclass(frozen=True)
class PeriodRow:
    """How even a period was [ms].

    Attributes:
        name: Of what.
        p50: Median period.
        p99: 99th percentile of the period.
        p99_9: 99.9th percentile of the period.
        largest: The largest period.
        jitter_p99_9: 99.9th percentile of how far a period was off the nominal one.
        ratio: Of that to the bare loop's.
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

    The loop is the whole of the hardware path: LCM, cameras, tracker in its worker, propagator,
    field, inverse kinematics and log, held in the phase in which the object follows its reference.
    The stand-in sends statuses a thousand times a second and pictures of the scenario eight times,
    and notes the stamps of the commands, whose period is what counts. In the middle of the run the
    tracker's process is stopped for a second. Before it, a bare loop that does nothing but wait
    tells what the machine itself does to a period.

    Args:
        duration: Of the run [s].
        json_path: Where the figures go.
    """
    KeepMemory()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenario = with_own_networks(ChooseScenario())
        plan = _plan(scenario, folder)
        period = scenario.poil.rates.control
        bare = _bare_loop(scenario)
        with _stand_in(scenario, plan, folder) as robot:
            timing, stalled, end = _run(scenario, plan, folder, duration)
            said, _ = robot.communicate(timeout=60)
        commanded = np.array(json.loads(said.splitlines()[-1])["commanded"])
    # Neither while all is set up, nor the rest that is commanded on the way out.
    commanded = commanded[(commanded > commanded[0] + _WARM_UP) & (commanded < end)]
    rows = summarize({"bare loop": bare, "commands": commanded}, period)
    ticks = np.array(timing.starts)
    late = np.array(timing.lateness)[(ticks >= stalled[0]) & (ticks <= stalled[1])]
    figures = {
        "period_ms": 1e3 * period,
        "duration_s": duration,
        "realtime_priority": scenario.poil.hardware.realtime_priority,
        "missed_ticks": timing.missed,
        "missed_ticks_while_stalled": int((late > period).sum()),
        "rows": [asdict(row) for row in rows],
        "loop": timing.figures(),
    }
    write_json(figures, json_path)
    print(_table(rows))
    print(
        f"missed ticks: {timing.missed} of {len(ticks)}, "
        f"{figures['missed_ticks_while_stalled']} of {late.size} while the tracker was stalled"
    )
    return rows


def summarize(stamps: dict[str, np.ndarray], period: float) -> list[PeriodRow]:
    """Returns the percentiles of the periods between stamps (T,) [s]; the first is the baseline."""
    rows: list[PeriodRow] = []
    for name, times in stamps.items():
        periods = np.diff(times)
        p50, p99, p99_9, largest = (1e3 * np.percentile(periods, [50, 99, 99.9, 100])).tolist()
        jitter = 1e3 * float(np.percentile(np.abs(periods - period), 99.9))
        baseline = rows[0].jitter_p99_9 if rows else jitter
        rows.append(PeriodRow(name, p50, p99, p99_9, largest, jitter, jitter / baseline))
    return rows


def _plan(scenario: Scenario, folder: Path) -> ExecutionPlan:
    """Returns the plan to hang the mug, with a reference that hardly moves."""
    RecordScenarioDemonstration(scenario, folder / "demo.mcap")
    plan = PlanScenario(scenario, folder / "demo.mcap")
    times = np.linspace(0.0, 1000.0, len(plan.reference.times))
    rise = np.array([0.0, 0.0, _SLOW_RISE])
    positions = plan.target_points + times[:, None, None] * rise
    velocities = np.tile(rise, (len(times), len(plan.target_points), 1))
    velocities[-1] = 0.0
    return dataclasses.replace(plan, reference=PointTrajectory(times, positions, velocities))


def _bare_loop(scenario: Scenario) -> np.ndarray:
    """Returns when the ticks of a loop began that does nothing [s]."""
    period = scenario.poil.rates.control
    stamps = []
    with QuietInterpreter(), RealTimeScheduling(scenario.poil.hardware.realtime_priority):
        start = time.perf_counter()
        for tick in range(round(_BARE / period)):
            time.sleep(max(0.0, start + tick * period - time.perf_counter()))
            stamps.append(time.perf_counter())
    return np.array(stamps)


@contextmanager
def _stand_in(
    scenario: Scenario, plan: ExecutionPlan, folder: Path
) -> Iterator[subprocess.Popen[str]]:
    with MakeStation(scenario, ignore_output_delay=True) as station:
        frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)
    pictures = {
        f"{camera.name}.{kind}": getattr(image, kind)
        for camera, image in zip(frame.cameras, frame.images, strict=True)
        for kind in ("rgb", "depth", "label")
    }
    np.savez(folder / "pictures.npz", **pictures)
    setup = StandInSetup(
        robot_url=scenario.lcm_buses["robot"].lcm_url,
        image_url=scenario.lcm_buses["images"].lcm_url,
        position=tuple(plan.approach.positions[0].tolist()),
        holds=_HELD_WIDTH,
        pictures=str(folder / "pictures.npz"),
        cameras=tuple(scenario.cameras),
        image_period=scenario.poil.rates.tracker,
    )
    with running_stand_in(setup, folder) as process:
        yield process


def _run(
    scenario: Scenario, plan: ExecutionPlan, folder: Path, duration: float
) -> tuple[LoopTiming, tuple[float, float], float]:
    """Returns the loop's timing, when the tracker was stalled [s], and the end [s since epoch]."""
    with RunLogWriter(folder / "run.mcap", config=RunLogConfig(drop_when_full=True)) as log:
        loop = MakeClosedLoop(scenario, plan, hardware=True, log=log)
        try:
            simulator = Simulator(loop.diagram)
            pace = RealTimeLoop(simulator, period=scenario.poil.rates.control, pause=COMMAND_SHARE)
            simulator.Initialize()
            loop.station.WarmUp()
            stall = _Stall(loop)
            with (
                QuietInterpreter(),
                RealTimeScheduling(scenario.poil.hardware.realtime_priority, followers=True),
                OneLineTqdm(total=round(duration), desc="seconds") as bar,
            ):
                pace.AdvanceTo(_WARM_UP)
                # The first track is there; what follows would be grasp and lift.
                loop.sequencer.GetMyMutableContextFromRoot(
                    simulator.get_mutable_context()
                ).SetDiscreteState(_following())
                pace.timing = LoopTiming()
                for second in range(round(duration)):
                    if second == round(duration) // 2:
                        stall.start()
                    pace.AdvanceTo(_WARM_UP + second + 1.0)
                    bar.update()
                end = time.time()
            stall.join()
            return pace.timing, stall.times, end
        finally:
            loop.Close()


def _following() -> np.ndarray:
    """Returns the sequencer's memory of an object that follows, and never has to progress."""
    return np.array(
        SkillState(
            phase=float(Phase.FOLLOW),
            width=0.0,
            best_error=-np.inf,
            best_tau=np.inf,
            progress_at=np.inf,
        )
    )


class _Stall:
    """Stops the tracker's process for a while."""

    def __init__(self, loop: ClosedLoop):
        assert isinstance(loop.tracker, PointTracker)
        pid = loop.tracker.worker_pid
        if pid is None:
            raise StationError(
                "The tracker runs in no process of its own, which could be stopped.",
                remedy="Choose a tracker that looks through cameras.",
            )
        self._pid, self._thread = pid, threading.Thread(target=self._stall, daemon=True)
        self.times = (np.inf, np.inf)

    def start(self) -> None:
        self._thread.start()

    def join(self) -> None:
        self._thread.join()

    def _stall(self) -> None:
        start = time.perf_counter()
        os.kill(self._pid, signal.SIGSTOP)
        try:
            time.sleep(_STALL)
        finally:
            os.kill(self._pid, signal.SIGCONT)
        self.times = (start, time.perf_counter())


def _table(rows: list[PeriodRow]) -> str:
    lines = [
        f"{'period [ms]':12s} {'p50':>7s} {'p99':>7s} {'p99.9':>7s} {'largest':>8s} "
        f"{'jitter p99.9':>13s}   ratio"
    ]
    lines += [
        f"{row.name:12s} {row.p50:7.3f} {row.p99:7.3f} {row.p99_9:7.3f} {row.largest:8.3f} "
        f"{row.jitter_p99_9:13.3f} {row.ratio:7.2f}"
        for row in rows
    ]
    return "\n".join(lines)
