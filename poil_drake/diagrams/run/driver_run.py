"""Runs a simulated robot behind its driver's network interface, in real time."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from poil_drake.diagrams.run.finished_run import REQUIRED_HANGING_TIME
from poil_drake.diagrams.run.html_recording import MakeMeshcat
from poil_drake.diagrams.run.output_paths import failure_reason
from poil_drake.diagrams.run.real_time_loop import RealTimeLoop
from poil_drake.diagrams.run.task_success import SimulatedTruth
from poil_drake.diagrams.scenario.hardware_config import ROBOT_BUS_URL
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.capture_sources import BusUrl
from poil_drake.diagrams.station.driver_station import MakeDriverStation
from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.runtime.held_signals import HeldSignals
from poil_drake.runtime.real_time import KeepMemory, QuietInterpreter, RealTimeScheduling
from poil_drake.systems.lcm.network import LcmNetwork
from poil_drake.systems.lcm.simulated_driver import STATUS_PERIOD


@dataclass(frozen=True, kw_only=True)
class DriverSummary:
    """The outcome of a run of the simulated driver.

    Attributes:
        hangs: Whether `hanging_time` is at least 2 s, the `REQUIRED_HANGING_TIME`.
        reason: Why the driver ended.
        hanging_time: How long the object had hung on its fixture at the end [s, simulated].
        seed: The scenario's seed.
        simulated: Simulated time [s].
        time_scale: Simulated seconds per second of real time.
        largest_lag: Largest lag of the simulation behind the clock [s, simulated].
        figures: Timing of the loop: name (with its unit) -> value.
    """

    hangs: bool
    reason: str
    hanging_time: float
    seed: int
    simulated: float
    time_scale: float
    largest_lag: float
    figures: dict[str, float]


def RunDriver(
    scenario: Scenario,
    *,
    duration: float = math.inf,
    json: Path | None = None,
    show: bool = False,
    say: Callable[[str], None] = print,
) -> DriverSummary:
    """Simulates the robot and the cameras to which the hardware station connects.

    Args:
        scenario: The scene, and in `poil.hardware` the networks and the time scale.
        duration: How long to run [s, simulated].
        json: Path of the summary, which is written however the driver ends. None writes none.
        show: Whether to serve a Meshcat page with the simulated scene.
        say: Called with a line when the driver listens, and at the end with the object's state.

    Raises:
        PoilError: if the driver cannot be built, or stops after an invalid command or a reflex, as
            the real driver would.
        BaseException: if anything else stops the driver, e.g. KeyboardInterrupt. The summary is
            written first.
    """
    poil, hardware = scenario.poil, scenario.poil.hardware
    KeepMemory()
    url = BusUrl(scenario, hardware.robot_bus, ROBOT_BUS_URL)
    lcm = LcmNetwork(url, realtime_priority=hardware.realtime_priority)
    robot = MakeDriverStation(
        scenario,
        lcm,
        meshcat=MakeMeshcat() if show else None,
        clock=hardware.clock(),
    )
    simulator = Simulator(robot.diagram)
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    simulator.set_target_realtime_rate(0.0)  # `RealTimeLoop` does the pacing.
    root = simulator.get_mutable_context()
    truth = SimulatedTruth(robot.station)
    loop = RealTimeLoop(
        simulator,
        period=min(STATUS_PERIOD, poil.rates.plant),
        time_scale=hardware.time_scale,
    )
    try:
        try:
            if robot.renderer is not None:
                robot.renderer.warm_up()
            simulator.Initialize()
            say(f"the simulated driver listens on {url}; Ctrl-C ends it")
            # A driver must not be late, whatever else this machine does.
            priority = min(hardware.realtime_priority + 1, 99) if hardware.realtime_priority else 0
            with QuietInterpreter(), RealTimeScheduling(priority):
                while root.get_time() < duration:
                    loop.AdvanceTo(min(poil.rates.next_report(root.get_time()), duration))
                    truth.observe(root)
            reason = "the duration has passed"
        except BaseException as error:  # KeyboardInterrupt, too; raised again after the summary.
            reason = failure_reason(error)
            raise
        finally:
            with HeldSignals():  # A second signal must not interrupt the writing.
                hung = truth.judge.hanging_time(root.get_time())
                summary = DriverSummary(
                    hangs=hung >= REQUIRED_HANGING_TIME,
                    reason=reason,
                    hanging_time=hung,
                    seed=scenario.random_seed,
                    simulated=root.get_time(),
                    time_scale=hardware.time_scale,
                    largest_lag=hardware.time_scale * max(loop.timing.lateness, default=0.0),
                    figures=loop.timing.figures(),
                )
                if json is not None:
                    write_json(asdict(summary), json)
                verdict = f"hangs (for {hung:.1f} s so far)" if summary.hangs else "does not hang"
                say(f"in the simulation the {poil.object} {verdict} on the {poil.fixture}")
    finally:
        robot.Close()
    return summary
