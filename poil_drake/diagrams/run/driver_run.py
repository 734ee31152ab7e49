"""Runs a simulated robot behind its driver's network interface, at the pace of the clock."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from poil_drake.diagrams.run.html_recording import MakeMeshcat
from poil_drake.diagrams.run.real_time_loop import (
    QuietInterpreter,
    RealTimeLoop,
    RealTimeLoopConfig,
)
from poil_drake.diagrams.run.report import REQUIRED_HANGING_TIME, failure_reason
from poil_drake.diagrams.run.simulated_truth import SimulatedTruth
from poil_drake.diagrams.run.simulator import MakeSimulator
from poil_drake.diagrams.scenario.hardware_config import ROBOT_BUS_URL
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.capture_sources import BusUrl
from poil_drake.diagrams.station.driver_station import MakeDriverStation
from poil_drake.recording.mcap.plain_json import plain_json, write_json
from poil_drake.runtime.held_signals import HeldSignals
from poil_drake.runtime.real_time_memory import KeepMemory
from poil_drake.runtime.real_time_scheduling import RealTimeScheduling
from poil_drake.systems.lcm.network import LcmNetwork
from poil_drake.systems.panda.simulated_driver import SimulatedDriverConfig


@dataclass(frozen=True, kw_only=True)
class DriverSummary:
    """What a simulated driver saw until it ended.

    Attributes:
        hangs: Whether the object hangs on its fixture, untouched by anything else, for long enough.
        reason: Why the driver ended.
        hanging_time: For how long it has hung [s].
        seed: Of the scenario.
        simulated: The robot's time [s].
        time_scale: Seconds of the robot's time per second.
        largest_lag: How far the simulation fell behind the clock at worst [s of the robot's time].
        figures: Of the loop's timing, name (with its unit) -> value.
    """

    hangs: bool
    reason: str
    hanging_time: float
    seed: int
    simulated: float
    time_scale: float
    largest_lag: float
    figures: dict[str, float] = field(default_factory=dict)


def RunDriver(
    scenario: Scenario,
    *,
    duration: float = math.inf,
    json: Path | None = None,
    show: bool = False,
    config: SimulatedDriverConfig | None = None,
    say: Callable[[str], None] = print,
) -> DriverSummary:
    """Simulates the scenario's robot and cameras for the hardware station to talk to.

    Args:
        scenario: What stands where, and in `poil.hardware` the networks and the time scale.
        duration: How long to run [s of the robot's time].
        json: Where the summary goes, however the driver ends; None: nowhere.
        show: Whether to serve a Meshcat page with the simulated scene.
        config: How the driver behaves; None for the defaults, with the scenario's expiry.
        say: Told in a line when the driver listens, and in another how the object was left.

    Raises:
        PoilError: if it cannot be built, or ends as the real one does: after a wrong command, or
            a reflex.
        BaseException: that stopped it, after the summary was written.
    """
    hardware = scenario.poil.hardware
    config = config or SimulatedDriverConfig(expire_sec=hardware.command_expiry)
    KeepMemory()
    url = BusUrl(scenario, hardware.robot_bus, ROBOT_BUS_URL)
    lcm = LcmNetwork(url, realtime_priority=hardware.realtime_priority)
    robot = MakeDriverStation(
        scenario,
        lcm,
        channels=hardware.channels,
        config=config,
        cameras=True,
        meshcat=MakeMeshcat() if show else None,
        clock=hardware.clock(),
    )
    simulator = MakeSimulator(robot.diagram, scenario, realtime_rate=0.0)
    root = simulator.get_mutable_context()
    truth = SimulatedTruth.of(robot.station)
    loop = RealTimeLoop(
        simulator,
        period=min(config.status_period, scenario.poil.rates.plant),
        config=RealTimeLoopConfig(time_scale=hardware.time_scale),
    )
    reason = "stopped by the user"  # As long as nothing else is known.
    try:
        try:
            if robot.renderer is not None:
                robot.renderer.warm_up()
            simulator.Initialize()
            say(f"the simulated driver listens on {url}; Ctrl-C ends it")
            # What stands for a robot must not be late, whatever else this machine does.
            priority = min(hardware.realtime_priority + 1, 99) if hardware.realtime_priority else 0
            with QuietInterpreter(), RealTimeScheduling(priority):
                while root.get_time() < duration:
                    loop.AdvanceTo(min(scenario.poil.rates.next_report(root.get_time()), duration))
                    truth.judge_now(root)
            reason = "its time was up"
        except BaseException as error:  # Of signals, too; it goes on once the summary is written.
            reason = failure_reason(error)
            raise
        finally:
            with HeldSignals():  # A second one must not lose what is written here.
                summary = _summary(scenario, root.get_time(), truth, loop, reason)
                if json is not None:
                    write_json(plain_json(asdict(summary)), json)
                poil = scenario.poil
                hangs = f"hangs (for {summary.hanging_time:.1f} s so far)"
                verdict = hangs if summary.hangs else "does not hang"
                say(f"in the simulation the {poil.object} {verdict} on the {poil.fixture}")
    finally:
        robot.Close()
    return summary


def _summary(
    scenario: Scenario, now: float, truth: SimulatedTruth, loop: RealTimeLoop, reason: str
) -> DriverSummary:
    hung, time_scale = truth.judge.hanging_time(now), scenario.poil.hardware.time_scale
    return DriverSummary(
        hangs=hung >= REQUIRED_HANGING_TIME,
        reason=reason,
        hanging_time=hung,
        seed=scenario.random_seed,
        simulated=now,
        time_scale=time_scale,
        largest_lag=time_scale * max(loop.timing.lateness, default=0.0),
        figures=loop.timing.figures(),
    )
