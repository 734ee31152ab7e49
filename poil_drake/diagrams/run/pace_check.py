"""Finds out before a run on hardware whether this machine keeps the control rate."""

import tempfile
import time
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator

from poil_drake.diagrams.loop.closed_loop import MakeClosedLoop
from poil_drake.diagrams.run.real_time_loop import RealTimeLoop
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.hardware.panda_hardware import COMMAND_SHARE
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.run_log.writer import RunLogConfig, RunLogWriter
from poil_drake.runtime.real_time import QuietInterpreter, RealTimeScheduling
from poil_drake.systems.skill.phases import Phase
from poil_drake.systems.skill.state_machine import SkillState

_SETTLING, _DURATION = 0.5, 1.5
"""The loop runs for `_DURATION` [s], of which the first `_SETTLING` [s] do not count."""

_KEPT = 95.0
"""A machine keeps a period if this percentage of the ticks takes no longer."""


FOLLOWING = SkillState(
    phase=float(Phase.FOLLOW),
    width=0.0,
    best_error=-np.inf,
    best_tau=np.inf,
    progress_at=np.inf,
)
"""A state of the skill in which the object follows its reference and never counts as stuck."""


def pace_warning(plan: ExecutionPlan, scenario: Scenario) -> str | None:
    """Measures the loop's ticks in a short dry run, which sends nothing to the robot.

    The run itself does a little more: it shows the scene, sends commands and tracks every image.

    Args:
        plan: The plan to execute.
        scenario: The station and the task.

    Returns:
        A warning with the rate that this machine keeps, or None if that is the control rate.

    Raises:
        PoilError: if the loop cannot be built, or a camera or the robot stops sending.
    """
    hardware, period = scenario.poil.hardware, scenario.poil.rates.control
    with tempfile.TemporaryDirectory() as folder:
        durations = _tick_durations(plan, scenario, Path(folder))
    work, asked = float(np.percentile(durations, _KEPT)), period / hardware.time_scale
    if work <= asked:
        return None
    return (
        f"this machine is too slow for the control rate of {1.0 / asked:.0f} Hz: one period in "
        f"{100.0 / (100.0 - _KEPT):.0f} takes {1e3 * work:.1f} ms or more, so it keeps "
        f"{1.0 / work:.0f} Hz. Commands will be late. End other programs, or raise "
        "poil.rates.control."
    )


def _tick_durations(plan: ExecutionPlan, scenario: Scenario, folder: Path) -> np.ndarray:
    """Returns how long the loop's ticks take [s], without waiting."""
    hardware, period = scenario.poil.hardware, scenario.poil.rates.control
    with RunLogWriter(folder / "run.mcap", config=RunLogConfig(drop_when_full=True)) as log:
        loop = MakeClosedLoop(scenario, plan, hardware=True, dry_run=True, log=log)
        try:
            simulator = Simulator(loop.diagram)
            pace = RealTimeLoop(
                simulator, period=period, time_scale=hardware.time_scale, pause=COMMAND_SHARE
            )
            root = simulator.get_mutable_context()
            with QuietInterpreter(), RealTimeScheduling(hardware.realtime_priority, followers=True):
                simulator.Initialize()
                loop.station.WarmUp()
                context = loop.sequencer.GetMyMutableContextFromRoot(root)
                context.SetDiscreteState(np.array(FOLLOWING))
                start, settled = time.perf_counter(), 0
                while (elapsed := time.perf_counter() - start) < _DURATION:
                    if elapsed < _SETTLING:
                        settled = len(pace.timing.durations)
                    pace.AdvanceTo(root.get_time() + period)
        finally:
            loop.Close()
    return np.array(pace.timing.durations)[settled:]
