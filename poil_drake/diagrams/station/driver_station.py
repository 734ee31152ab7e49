"""A simulated robot that the hardware station commands over LCM, like the real one."""

import time
from dataclasses import dataclass, replace

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder

from poil_drake.diagrams.scenario.hardware_config import IMAGE_BUS_URL, LcmImages
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.camera_process import CameraProcess
from poil_drake.diagrams.station.cameras.capture_sources import BusUrl, ImageChannel
from poil_drake.diagrams.station.station import MakeStation, SimulatedStation
from poil_drake.systems.cameras.lcm_cameras import LcmCameraFeed
from poil_drake.systems.lcm.network import Clock, LcmPump, MessageNetwork
from poil_drake.systems.lcm.simulated_driver import SimulatedDriver, SimulatedHand


@dataclass(frozen=True, kw_only=True)
class DriverStation:
    """A simulated robot and its driver.

    Attributes:
        diagram: The whole diagram, ready for a Simulator.
        station: The simulated robot and its surroundings.
        feed: Sends the cameras' images over LCM; None without cameras.
        renderer: Renders the cameras' images; None without cameras.
    """

    diagram: Diagram
    station: SimulatedStation
    feed: LcmCameraFeed | None = None
    renderer: CameraProcess | None = None

    def Close(self) -> None:
        """Ends the thread of `feed` and the process of `renderer`, if any."""
        if self.feed is not None and self.renderer is not None:
            # First the thread that sends requests, then the process that answers them.
            self.feed.close()
            self.renderer.close()


def MakeDriverStation(
    scenario: Scenario,
    lcm: MessageNetwork,
    *,
    meshcat: Meshcat | None = None,
    clock: Clock = time.time,
) -> DriverStation:
    """Builds a simulated robot that receives commands and sends statuses over LCM.

    It also sends the images of the cameras that the hardware station reads from LCM. Call
    `DriverStation.Close` after use.

    Args:
        scenario: The models, the cameras and the channels.
        lcm: The network. The diagram handles its subscriptions at every plant step.
        meshcat: Shows the simulated scene; None shows nothing.
        clock: Returns the driver's time [s since the epoch].

    Raises:
        PoilError: if the station cannot be built.
    """
    hardware = scenario.poil.hardware
    channels = hardware.channels
    builder = DiagramBuilder()
    builder.AddNamedSystem("lcm", LcmPump(network=lcm, period=scenario.poil.rates.plant))
    station = MakeStation(scenario, meshcat=meshcat, cameras=False)
    assert isinstance(station, SimulatedStation)
    builder.AddNamedSystem("station", station)
    driver = builder.AddNamedSystem(
        "driver",
        SimulatedDriver(
            lcm=lcm,
            command_channel=channels.command,
            status_channel=channels.status,
            period=scenario.poil.rates.plant,
            expiry=hardware.command_expiry,
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
    feed, renderer = _add_feed(builder, scenario, station, clock)
    return DriverStation(diagram=builder.Build(), station=station, feed=feed, renderer=renderer)


def _add_feed(
    builder: DiagramBuilder, scenario: Scenario, station: SimulatedStation, clock: Clock
) -> tuple[LcmCameraFeed, CameraProcess] | tuple[None, None]:
    hardware = scenario.poil.hardware
    channels = {}
    for name in scenario.cameras:
        source = hardware.cameras.get(name, LcmImages())
        if isinstance(source, LcmImages):
            channels[name] = ImageChannel(source, name)
    if not channels:
        return None, None
    cameras = {name: scenario.cameras[name] for name in channels}
    renderer = CameraProcess(replace(scenario, cameras=cameras))
    plant = station.plant()
    feed = builder.AddNamedSystem(
        "camera_feed",
        LcmCameraFeed(
            renderer=renderer,
            channels=channels,
            url=BusUrl(scenario, hardware.image_bus, IMAGE_BUS_URL),
            num_positions=plant.num_positions(),
            num_velocities=plant.num_velocities(),
            period=scenario.poil.rates.tracker,
            clock=clock,
        ),
    )
    builder.Connect(station.GetOutputPort("plant_state"), feed.GetInputPort("plant_state"))
    return feed, renderer
