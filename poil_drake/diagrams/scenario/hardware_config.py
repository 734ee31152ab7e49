"""How the real robot and its cameras are reached."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from poil_drake.errors import ScenarioError
from poil_drake.perception.capture.config import McapPlayback, OpenCvStreams, RealSense, Zed
from poil_drake.systems.lcm.network import check_channel
from poil_drake.systems.panda.lcm_messages import PandaChannels

ROBOT_BUS_URL = "udpm://239.255.76.67:7667?ttl=0"
"""LCM's usual address, on this machine only."""

IMAGE_BUS_URL = "udpm://239.255.76.67:7668?ttl=0&recv_buf_size=4194304"
"""Images have a port of their own: the robot's messages are not to be lost among them."""


@dataclass(frozen=True, kw_only=True)
class LcmImages:
    """A camera that another process reads, or simulates, and sends over LCM.

    Attributes:
        channel: Where; empty: Drake's own, DRAKE_RGBD_CAMERA_IMAGES_<camera>.
        labels: Whether label images come along, not necessarily with every image, as from a
            segmentation node, or from a simulation. Their numbers are those of the scenario's
            models, in order (see `AssignLabels`).
    """

    channel: str = ""
    labels: bool = True

    def __post_init__(self) -> None:
        if self.channel:
            check_channel(self.channel, "LcmImages.channel")


CameraSource = LcmImages | RealSense | Zed | OpenCvStreams | McapPlayback
"""Where a camera's images come from; in YAML a tag tells which, e.g. `!RealSense {serial: ...}`."""


@dataclass(frozen=True, kw_only=True)
class HardwareConfig:
    """The real robot, or a simulated driver in its place.

    Attributes:
        robot_bus: Which of `lcm_buses` leads to the Franka driver; one that the scenario does not
            define is LCM's usual address, on this machine only.
        image_bus: Which leads to the cameras of type `LcmImages`; likewise, with a port of its own.
        channels: The Franka driver's.
        cameras: Where each of the scenario's `cameras` gets its images; `LcmImages` where nothing
            is said.
        speed: How fast motions are, as a share of what they are in simulation, and of the joints'
            speed limits: a fifth, so that there is time for the stop button.
        command_expiry: The driver's --expire_sec: for so long it follows a command [s].
        ready_timeout: How long to wait for the first status and the first images [s].
        realtime_priority: Of the loop's thread, from 1 to 99, where the kernel permits it (as the
            Franka driver needs it, too, and at a higher one); 0 asks for nothing.
        time_scale: Seconds of the robot's time per second. 1 for every real robot; less where a
            machine is too slow for a simulated driver, which must be told the same.
    """

    robot_bus: str = "robot"
    image_bus: str = "images"
    channels: PandaChannels = field(default_factory=PandaChannels)
    cameras: Mapping[str, CameraSource] = field(default_factory=dict)
    speed: float = 0.2
    command_expiry: float = 0.1
    ready_timeout: float = 10.0
    realtime_priority: int = 20
    time_scale: float = 1.0

    def __post_init__(self) -> None:
        for name, largest in (
            ("speed", 1.0),
            ("command_expiry", math.inf),
            ("ready_timeout", math.inf),
            ("time_scale", 1.0),
        ):
            value = getattr(self, name)
            if not (0.0 < value <= largest and math.isfinite(value)):
                raise ScenarioError(
                    f"poil.hardware.{name} is {value}.",
                    remedy="It must be positive"
                    + (f", and {largest:g} at most." if largest < math.inf else " and finite."),
                )

        if not 0 <= self.realtime_priority <= 99:
            raise ScenarioError(
                f"poil.hardware.realtime_priority is {self.realtime_priority}.",
                remedy="It must be from 1 to 99, or 0 for none.",
            )

    def clock(self) -> Callable[[], float]:
        """Returns the clock that we share with the driver [s since the epoch, scaled]."""
        if self.time_scale == 1.0:
            return time.time
        return lambda: self.time_scale * time.time()

    def steady_clock(self) -> Callable[[], float]:
        """Returns a clock that agrees with the other now, and is not set when that one is."""
        scale, offset = self.time_scale, time.time() - time.monotonic()
        return lambda: scale * (time.monotonic() + offset)
