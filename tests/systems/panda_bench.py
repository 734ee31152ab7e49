"""The Panda's drivers on networks in memory, and what talks to them."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from drake import (
    lcmt_panda_command,
    lcmt_panda_status,
    lcmt_schunk_wsg_command,
    lcmt_schunk_wsg_status,
)
from network_bench import NetworkBench
from pydrake.systems.framework import System
from system_bench import START, SystemBench

from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.velocity_limiter import VelocityLimiter
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.panda_messages import (
    decode_hand_status,
    decode_panda_status,
    same_panda,
)
from poil_drake.systems.lcm.panda_receivers import FrankaStatusReceiver, HandStatusReceiver
from poil_drake.systems.lcm.panda_senders import FrankaCommandSender, HandCommandSender
from poil_drake.systems.safety.faults import SafetyConfig

PERIOD = 1 / 256
LIMITER = VelocityLimiter(
    limits=PandaModel().joint_limits, period=PERIOD, config=SafetyConfig().limiter
)
JOINTS = [0.1, -0.2, 0.3, -1.5, 0.5, 1.6, 0.7]


def arm_status(stamp: float, **changes: object) -> bytes:
    message = lcmt_panda_status()
    message.utime = round(1e6 * stamp)
    message.num_joints = 7
    for name in message.__slots__:
        if name.startswith("joint"):
            setattr(message, name, [0.0] * 7)
    message.joint_position = JOINTS
    message.joint_velocity = [0.01 * k for k in range(7)]
    message.joint_torque_external = [1.0 * k for k in range(7)]
    message.robot_mode = lcmt_panda_status.kMove
    message.control_command_success_rate = 0.98
    for name, value in changes.items():
        setattr(message, name, value)
    return message.encode()


def hand_status(width: float, stamp: float = START) -> bytes:
    message = lcmt_schunk_wsg_status()
    message.utime, message.actual_position_mm = round(1e6 * stamp), 1e3 * width
    return message.encode()


class FakeTime:
    """Replaces the module `time`; time passes only in `sleep`."""

    def __init__(self) -> None:
        self.now = 100.0

    def time(self) -> float:
        return self.now

    def monotonic(self) -> float:
        return self.now

    def sleep(self, duration: float) -> None:
        self.now += duration


class RobotBench(NetworkBench):
    """A command sender and a status receiver on one network; the test plays the driver.

    Attributes:
        receiver: The receiver, simulated separately.
        sent: Commands since the start, or since the last `send` or `rest` began.
        elapsed: Time since `START` by the clock [s]; set by the test.
        outdated: Whether the last update was too long ago, for the sender.
    """

    elapsed, outdated = 0.0, False

    def __init__(
        self,
        make_sender: Callable[..., System],
        make_receiver: Callable[..., System],
        make_mailbox: Callable[..., LcmMailbox],
        decode_command: Callable[[bytes], Any],
    ):
        def make(**network: Any) -> System:
            self.mailbox = make_mailbox(network["lcm"], "STATUS")
            return make_sender(
                channel="COMMAND",
                mailbox=self.mailbox,
                outdated=lambda: self.outdated,
                **network,
            )

        super().__init__(make)
        self.sent = self.hear("COMMAND", decode_command)
        self.receiver = SystemBench(
            make_receiver(mailbox=self.mailbox, period=PERIOD, clock=self.now)
        )

    def now(self) -> float:
        return START + self.elapsed

    def report(self, status: bytes) -> None:
        self.publish("STATUS", status)

    def show(self, port: str) -> np.ndarray:
        """Evaluates the receiver's port after its next update."""
        self.receiver.advance(PERIOD)
        return self.receiver.read(port)

    def send(self, **inputs: Any) -> list[Any]:
        """Returns what the sender sends with these inputs."""
        self.fix(**inputs)
        self.sent.clear()
        self.dut.ForcedPublish(self.context)
        self.lcm.HandleSubscriptions(0)
        return self.sent

    def rest(self, duration: float) -> list[Any]:
        """Returns what the sender sends in `SendRest`."""
        self.sent.clear()
        self.dut.SendRest(duration)
        self.lcm.HandleSubscriptions(0)
        return self.sent


def make_arm_bench(bench: type[RobotBench] = RobotBench, **options: float) -> RobotBench:
    return bench(
        partial(FrankaCommandSender, limiter=LIMITER, period=PERIOD, **options),
        FrankaStatusReceiver,
        partial(LcmMailbox, decode=decode_panda_status, same_sender=same_panda),
        lcmt_panda_command.decode,
    )


def make_hand_bench(**options: float) -> RobotBench:
    return RobotBench(
        partial(HandCommandSender, period=0.1, **options),
        HandStatusReceiver,
        partial(LcmMailbox, decode=decode_hand_status),
        lcmt_schunk_wsg_command.decode,
    )
