"""A simulated robot behind its driver's network interface, for the hardware station."""

import time
from dataclasses import dataclass

from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.lcm import LcmInterfaceSystem

from poil_drake.diagrams.scenario import Scenario
from poil_drake.diagrams.station import MakeStation, Station
from poil_drake.systems.panda_lcm_messages import Clock, PandaChannels
from poil_drake.systems.simulated_driver import SimulatedDriver, SimulatedDriverConfig
from poil_drake.systems.simulated_hand import SimulatedHand


@dataclass(frozen=True, kw_only=True)
class DriverStation:
    """A simulated robot and its driver.

    Attributes:
        diagram: The whole, ready for a Simulator.
        station: The simulated robot and its surroundings.
        driver: The arm's end of the network.
        hand: The hand's end of the network.
    """

    diagram: Diagram
    station: Station
    driver: SimulatedDriver
    hand: SimulatedHand


def MakeDriverStation(
    scenario: Scenario,
    lcm: DrakeLcmInterface,
    *,
    channels: PandaChannels | None = None,
    config: SimulatedDriverConfig | None = None,
    clock: Clock = time.time,
) -> DriverStation:
    """Builds a simulated robot that obeys and reports over LCM as the real one does.

    Args:
        scenario: What stands where.
        lcm: The network; its subscriptions are handled between the steps.
        channels: Where what is said; None for the Franka driver's own.
        config: How the driver behaves; None for the defaults.
        clock: The driver's time [s since the epoch].

    Raises:
        PoilError: if the station cannot be built.
    """
    channels = channels or PandaChannels()
    builder = DiagramBuilder()
    builder.AddNamedSystem("lcm", LcmInterfaceSystem(lcm))
    station = builder.AddNamedSystem("station", MakeStation(scenario, cameras=False))
    driver = builder.AddNamedSystem(
        "driver",
        SimulatedDriver(
            lcm=lcm,
            command_channel=channels.command,
            status_channel=channels.status,
            period=scenario.poil.rates.plant,
            config=config,
            clock=clock,
        ),
    )
    hand = builder.AddNamedSystem(
        "hand",
        SimulatedHand(
            lcm=lcm,
            command_channel=channels.hand_command,
            status_channel=channels.hand_status,
            clock=clock,
        ),
    )
    robot = scenario.poil.robot
    for giver, output, taker, input_ in (
        (station, f"{robot}.position_measured", driver, "position_measured"),
        (station, f"{robot}.velocity_measured", driver, "velocity_measured"),
        (station, f"{robot}.torque_external", driver, "torque_external"),
        (driver, "velocity", driver, "velocity_commanded"),
        (driver, "velocity", station, f"{robot}.velocity"),
        (driver, "velocity_time", station, f"{robot}.velocity_time"),
        (station, "hand.width_measured", hand, "width_measured"),
        (hand, "width", station, "hand.width"),
    ):
        builder.Connect(giver.GetOutputPort(output), taker.GetInputPort(input_))
    return DriverStation(diagram=builder.Build(), station=station, driver=driver, hand=hand)
