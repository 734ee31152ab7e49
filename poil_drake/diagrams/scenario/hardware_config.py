"""The `poil.hardware` section of a scenario: the real robot and its cameras."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from poil_drake.diagrams.scenario.value_ranges import require_positive
from poil_drake.errors import ScenarioError
from poil_drake.perception.capture.config import McapPlayback, OpenCvStreams, RealSense, Zed
from poil_drake.systems.lcm.network import check_channel
from poil_drake.systems.lcm.panda_messages import PandaChannels

ROBOT_BUS_URL = "udpm://239.255.76.67:7667?ttl=0"
"""The robot bus's default address: LCM's own default, restricted to this machine (ttl=0)."""

IMAGE_BUS_URL = "udpm://239.255.76.67:7668?ttl=0&recv_buf_size=4194304"
"""The image bus's default address. Its own port keeps images from delaying the robot's messages."""


@dataclass(frozen=True, kw_only=True)
class LcmImages:
    """A camera whose images arrive over LCM from another process.

    Attributes:
        channel: LCM channel; empty means Drake's default, DRAKE_RGBD_CAMERA_IMAGES_<camera>.
        labels: Whether messages may include label images, e.g. from a segmentation node or a
            simulation. Label numbers follow the order of the scenario's models (see
            `AssignLabels`).
    """

    channel: str = ""
    labels: bool = True

    def __post_init__(self) -> None:
        if self.channel:
            check_channel(self.channel, "LcmImages.channel")


CameraSource = LcmImages | RealSense | Zed | OpenCvStreams | McapPlayback
"""The source of a camera's images, chosen in YAML by a tag, e.g. `!RealSense {serial: ...}`."""


@dataclass(frozen=True, kw_only=True)
class HardwareConfig:
    """The `poil.hardware` section: the real robot and cameras, or a simulated driver.

    Attributes:
        robot_bus: The key in `lcm_buses` of the Franka driver's network. If `lcm_buses` lacks the
            key, LCM's default address on this machine is used.
        image_bus: The key in `lcm_buses` of the network of `LcmImages` cameras. If `lcm_buses`
            lacks the key, a separate port on this machine is used.
        channels: LCM channels of the Franka driver.
        cameras: Name of one of the scenario's `cameras` -> source of its images; cameras that are
            not listed use `LcmImages`.
        speed: Factor on all speeds and on the joints' speed limits; 1 is the speed in simulation.
            The default leaves time to press the stop button.
        command_expiry: How long the driver follows one command [s]. It must equal the driver's
            option --expire_sec.
        ready_timeout: Longest wait for the robot's first status and the first images [s].
        realtime_priority: Real-time priority of the loop's thread, from 1 to 99, if the kernel
            permits it. It must be lower than the Franka driver's. 0 keeps ordinary scheduling.
        time_scale: Seconds of robot time per second of real time: 1 for real robots. A simulated
            driver on a slow machine may use less; the loop then needs the same value.
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
        require_positive("poil.hardware.speed", self.speed, largest=1.0)
        require_positive("poil.hardware.command_expiry", self.command_expiry)
        require_positive("poil.hardware.ready_timeout", self.ready_timeout)
        require_positive("poil.hardware.time_scale", self.time_scale, largest=1.0)
        if not 0 <= self.realtime_priority <= 99:
            raise ScenarioError(
                f"poil.hardware.realtime_priority is {self.realtime_priority}, out of range.",
                remedy="It must be from 1 to 99, or 0 for ordinary scheduling.",
            )

    def clock(self) -> Callable[[], float]:
        """Returns the clock shared with the driver: Unix time [s] times `time_scale`."""
        return lambda: self.time_scale * time.time()

    def steady_clock(self) -> Callable[[], float]:
        """Returns a clock that starts at `clock()` and ignores later changes of the system time."""
        scale, offset = self.time_scale, time.time() - time.monotonic()
        return lambda: scale * (time.monotonic() + offset)
