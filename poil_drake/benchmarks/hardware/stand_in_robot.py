"""A stand-in for a Franka, its driver and its cameras, in a separate, lightweight process.

It sends the driver's messages at the driver's rates, but has no dynamics: joints follow velocity
commands through a low-pass filter, the hand stops at the width of the object it holds, and each
camera sends the same image forever. (`poil driver`, in contrast, simulates the physics.)

`python -m poil_drake.benchmarks.hardware.stand_in_robot SETUP.json` prints "ready", runs until its
standard input is closed, and then prints the robot's records as JSON.
"""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.lcm import DrakeLcmParams

from poil_drake.errors import StationError
from poil_drake.perception.images import RgbdImage
from poil_drake.robots.panda import MAX_HAND_WIDTH, NUM_JOINTS
from poil_drake.runtime.real_time import RealTimeScheduling
from poil_drake.systems.cameras.lcm_image_messages import encode_images
from poil_drake.systems.lcm.network import LcmNetwork
from poil_drake.systems.lcm.panda_messages import (
    HAND_PERIOD,
    HandOpening,
    PandaChannels,
    PandaCommand,
    PandaStatus,
    decode_hand_command,
    decode_panda_command,
    encode_hand_status,
    encode_panda_status,
)
from poil_drake.systems.statuses import RobotMode

if TYPE_CHECKING:
    from poil_drake.diagrams.scenario.scenario import Scenario  # Slow to import.

PERIOD = 0.001
"""Period of the driver's loop [s]."""

_EXPIRY = 0.1  # [s], the driver's --expire_sec
_SMOOTHING = PERIOD * 2.0 * np.pi * 30.0  # the driver's low-pass filter of 30 Hz
_HAND_SPEED = 0.1  # [m/s]
_PRIORITY = 30
_KEPT = 200_000  # latest rows of each record
_READY = "ready\n"
_RECEIVE_BUFFER = 4_194_304  # [bytes], for images


@dataclass(frozen=True, kw_only=True)
class StandInSetup:
    """The setup of a stand-in robot.

    Attributes:
        robot_url: LCM network of the driver.
        image_url: LCM network of the cameras.
        position: Initial joint positions of the arm (7,) [rad].
        holds: Width of the object between the fingers [m].
        pictures: Path of an npz with the cameras' images: "<camera>.rgb", ".depth" and ".label".
        cameras: Names of the cameras.
        image_period: Time between two images of a camera [s].
        time_scale: Seconds of the robot's time per second; all other times are the robot's.
        fault: Name of a fault, for stand-ins that simulate faults.
        after: Time from the arm's first motion to the fault [s].
    """

    robot_url: str
    image_url: str
    position: tuple[float, ...]
    holds: float
    pictures: str
    cameras: tuple[str, ...]
    image_period: float = 0.125
    time_scale: float = 1.0
    fault: str = ""
    after: float = 0.0


class StandInRobot:
    """The arm, the hand and the cameras.

    Attributes:
        setup: The setup.
        position: Joint positions (7,) [rad].
        velocity: Joint velocities (7,) [rad/s].
        width: Opening of the hand [m].
        command: Last command for the arm; None before the first.
        hand_command: Last command for the hand; None before the first.
        speeds: Record of (time by `clock` [s], largest joint speed [rad/s]) in each step.
        commanded: Record of the stamps of received arm commands [s].
        told: Record of (time by `clock` [s], largest joint speed [rad/s]) of received arm commands.
        hand_told: Record of (time by `clock` [s], opening [m]) of received hand commands.
    """

    def __init__(self, setup: StandInSetup):
        """Opens the networks and reads the images."""
        self.setup, self.channels = setup, PandaChannels()
        self.lcm = LcmNetwork(setup.robot_url, realtime_priority=_PRIORITY)
        self.images = LcmNetwork(setup.image_url)
        self.command: PandaCommand | None = None
        self.hand_command: HandOpening | None = None
        self.position, self.velocity = np.array(setup.position), np.zeros(NUM_JOINTS)
        self.width = MAX_HAND_WIDTH
        self.speeds: list[tuple[float, float]] = []
        self.commanded: list[float] = []
        self.told: list[tuple[float, float]] = []
        self.hand_told: list[tuple[float, float]] = []
        self.lcm.Subscribe(self.channels.command, self._hear)
        self.lcm.Subscribe(self.channels.hand_command, self._hear_hand)
        pictures = np.load(setup.pictures)
        self.pictures = {
            name: [pictures[f"{name}.{kind}"] for kind in ("rgb", "depth", "label")]
            for name in setup.cameras
        }

    def _hear(self, message: bytes) -> None:
        self.command = decode_panda_command(message)
        self.commanded.append(self.command.stamp)
        self.told.append((self.clock(), float(np.abs(self.command.velocity).max())))

    def _hear_hand(self, message: bytes) -> None:
        self.hand_command = decode_hand_command(message)
        self.hand_told.append((self.clock(), self.hand_command.width))

    def clock(self) -> float:
        """Returns this process's time [s since the epoch], scaled by `time_scale`."""
        return self.setup.time_scale * time.time()

    def now(self) -> float:
        """Returns the driver's time [s]. It differs from `clock` only if a fault shifts it."""
        return self.clock()

    def desired_velocity(self, now: float) -> np.ndarray:
        """Returns the commanded velocity (7,) [rad/s]; zero if the last command has expired."""
        if self.command is None or abs(now - self.command.stamp) > _EXPIRY:
            return np.zeros(NUM_JOINTS)
        return self.command.velocity

    def step(self, tick: int) -> None:
        """Simulates the driver in its period number `tick`."""
        self.lcm.HandleSubscriptions(0)
        now = self.now()
        self.velocity = self.velocity + _SMOOTHING * (self.desired_velocity(now) - self.velocity)
        self.position = self.position + PERIOD * self.velocity
        self.speeds.append((self.clock(), float(np.abs(self.velocity).max())))
        self.send_status(now)
        if tick % round(HAND_PERIOD / PERIOD) == 0:
            self.move_hand(now)

    def status(self, stamp: float) -> PandaStatus:
        """Returns the arm's status, stamped with the driver's time [s]."""
        return PandaStatus(
            stamp=stamp,
            position=self.position,
            velocity=self.velocity,
            torque_external=np.zeros(NUM_JOINTS),
            mode=RobotMode.MOVE,
            success_rate=1.0,
        )

    def send_status(self, now: float) -> None:
        """Sends the arm's status, stamped with the driver's time [s]."""
        message = encode_panda_status(self.status(now), self.velocity)
        self.lcm.Publish(self.channels.status, message)

    def move_hand(self, now: float) -> None:
        """Moves the hand for one `HAND_PERIOD`, and sends its status with the driver's time [s]."""
        if self.hand_command is not None:
            step, goal = _HAND_SPEED * HAND_PERIOD, max(self.hand_command.width, self.setup.holds)
            self.width += min(max(goal - self.width, -step), step)
        status = HandOpening(stamp=now, width=self.width)
        self.lcm.Publish(self.channels.hand_status, encode_hand_status(status, False))

    def send_images(self) -> None:
        """Sends an image of each camera."""
        stamp = self.now()
        for name in self.pictures:
            self.images.Publish(self.image_channel(name), self.picture(name, stamp))

    def image_channel(self, camera: str) -> str:
        """Returns the LCM channel of a camera's images."""
        return f"DRAKE_RGBD_CAMERA_IMAGES_{camera}"

    def picture(self, camera: str, stamp: float) -> bytes:
        """Returns a camera's image as an LCM message, stamped with the driver's time [s]."""
        rgb, depth, label = self.pictures[camera]
        image = RgbdImage(rgb=rgb, depth=depth, stamp=stamp, label=label)
        return encode_images(image, camera=camera)

    def seen(self) -> dict[str, Any]:
        """Returns the latest rows of each record, by the name of its attribute."""
        kept = ("speeds", "commanded", "told", "hand_told")
        return {name: getattr(self, name)[-_KEPT:] for name in kept}

    def run(self) -> None:
        """Runs until standard input is closed."""
        ended = threading.Event()

        def wait_for_end() -> None:
            sys.stdin.read()
            ended.set()

        def send_images_periodically() -> None:
            while not ended.wait(self.setup.image_period / self.setup.time_scale):
                self.send_images()

        sys.setswitchinterval(1e-4)  # An image must not delay the statuses.
        for work in (wait_for_end, send_images_periodically):
            threading.Thread(target=work, daemon=True).start()
        print(_READY, end="", flush=True)
        period, start, tick = PERIOD / self.setup.time_scale, time.monotonic(), 0
        # A robot is never late, so its stand-in takes precedence on a busy machine.
        with RealTimeScheduling(_PRIORITY):
            while not ended.is_set():
                elapsed = time.monotonic() - start
                while tick * period < elapsed:
                    self.step(tick)
                    tick += 1
                time.sleep(0.5 * period)
        print(json.dumps(self.seen()), flush=True)


def with_own_networks(scenario: "Scenario") -> "Scenario":
    """Returns a scenario with LCM networks on this machine that no other process uses."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for one in sockets:
        one.bind(("", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    hardware = scenario.poil.hardware
    buses = {
        bus: DrakeLcmParams(
            lcm_url=f"udpm://239.255.76.67:{port}?ttl=0&recv_buf_size={_RECEIVE_BUFFER}"
        )
        for bus, port in zip((hardware.robot_bus, hardware.image_bus), ports, strict=True)
    }
    return replace(scenario, lcm_buses={**scenario.lcm_buses, **buses})


@contextmanager
def running_stand_in(
    setup: StandInSetup,
    folder: Path,
    *,
    program: Sequence[str] = ("-m", __name__),
    wait: bool = True,
) -> Iterator[subprocess.Popen[str]]:
    """Starts a stand-in robot as a process, and yields the process when the robot is ready.

    If its standard input is closed, the process prints its records in one line and ends. It is
    killed when the `with` block ends.

    Args:
        setup: The setup.
        folder: Folder for the setup's file.
        program: Arguments for Python: this module, or a program whose robot simulates faults.
        wait: Whether to wait until the robot is ready; if not, `wait_until_ready` waits.

    Raises:
        StationError: if the process does not start.
    """
    path = folder / "stand_in.json"
    path.write_text(json.dumps(asdict(setup)))
    process = subprocess.Popen(
        [sys.executable, "-P", *program, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        if wait:
            wait_until_ready(process)
        yield process
    finally:
        process.kill()
        process.wait()


def wait_until_ready(process: subprocess.Popen[str]) -> None:
    """Waits until the robot of a new process is ready.

    Raises:
        StationError: if the process does not start.
    """
    assert process.stdout is not None
    if process.stdout.readline() != _READY:
        raise StationError(
            "The stand-in robot did not start.", remedy="Read its messages on standard error."
        )


def read_setup(path: str) -> StandInSetup:
    """Returns the setup in a JSON file."""
    return StandInSetup(**json.loads(Path(path).read_text()))


if __name__ == "__main__":
    StandInRobot(read_setup(sys.argv[1])).run()
