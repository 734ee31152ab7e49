"""The Panda's drivers on networks in memory, and what talks to them."""

import numpy as np
from drake import (
    lcmt_panda_command,
    lcmt_panda_status,
    lcmt_schunk_wsg_command,
    lcmt_schunk_wsg_status,
)
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator

from poil_drake.control.velocity_limiter import VelocityLimiter
from poil_drake.systems.arm_plant import MakePandaKinematics
from poil_drake.systems.lcm_mailbox import LcmMailbox
from poil_drake.systems.panda_lcm import HandStatusReceiver, PandaStatusReceiver
from poil_drake.systems.panda_lcm_messages import (
    decode_hand_status,
    decode_panda_status,
    same_panda,
)
from poil_drake.systems.panda_senders import HandCommandSender, PandaCommandSender
from poil_drake.systems.safety_faults import SafetyConfig

PERIOD = 1 / 256


START = 1_790_000_000.0


LIMITER = VelocityLimiter(
    limits=MakePandaKinematics().joint_limits, period=PERIOD, config=SafetyConfig().limiter
)


JOINTS = [0.1, -0.2, 0.3, -1.5, 0.5, 1.6, 0.7]


class Clock:
    """A clock that is set by hand [s since the epoch]."""

    def __init__(self) -> None:
        self.now = START

    def __call__(self) -> float:
        return self.now


def status_message(stamp: float, **changes: object) -> lcmt_panda_status:
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
    return message


class FakeTime:
    """Stands for the module: time passes only where somebody sleeps."""

    def __init__(self) -> None:
        self.now = 100.0

    def time(self) -> float:
        return self.now

    def monotonic(self) -> float:
        return self.now

    def sleep(self, duration: float) -> None:
        self.now += duration


class Bench:
    """Both systems on a network in memory, and a driver that says what it is told to."""

    def __init__(self, **options: float):
        self.clock, self.lcm = Clock(), DrakeLcm("memq://test")
        self.mailbox = LcmMailbox(self.lcm, "STATUS", decode_panda_status, same_sender=same_panda)
        self.receiver = PandaStatusReceiver(mailbox=self.mailbox, period=PERIOD, clock=self.clock)
        self.simulator = Simulator(self.receiver)
        self.sender = PandaCommandSender(
            lcm=self.lcm,
            channel="COMMAND",
            mailbox=self.mailbox,
            limiter=LIMITER,
            period=PERIOD,
            update_age=lambda: self.update_age,
            clock=self.clock,
            **options,
        )
        self.update_age = 0.0
        self.context = self.sender.CreateDefaultContext()
        self.sent: list[lcmt_panda_command] = []
        self.lcm.Subscribe("COMMAND", lambda raw: self.sent.append(lcmt_panda_command.decode(raw)))

    def say(self, message: bytes) -> None:
        self.lcm.Publish("STATUS", message)
        self.lcm.HandleSubscriptions(0)

    def read(self, name: str) -> np.ndarray:
        context = self.simulator.get_mutable_context()
        self.simulator.AdvanceTo(context.get_time() + PERIOD)
        return self.receiver.GetOutputPort(name).Eval(context)

    def send(self, velocity: np.ndarray | None = None, time: float | None = None) -> list:
        if velocity is not None:
            self.sender.GetInputPort("velocity").FixValue(self.context, velocity)
        if time is not None:
            self.sender.GetInputPort("velocity_time").FixValue(self.context, [time])
        self.sent.clear()
        self.sender.ForcedPublish(self.context)
        self.lcm.HandleSubscriptions(0)
        return self.sent


class HandBench:
    """The hand's systems on a network in memory."""

    def __init__(self, *, offset: float = 0.0) -> None:
        self.update_age = 0.0
        self.clock, self.lcm = Clock(), DrakeLcm("memq://hand")
        self.mailbox = LcmMailbox(self.lcm, "STATUS", decode_hand_status)
        self.receiver = HandStatusReceiver(mailbox=self.mailbox, period=PERIOD, clock=self.clock)
        self.simulator = Simulator(self.receiver)
        self.sender = HandCommandSender(
            lcm=self.lcm,
            channel="COMMAND",
            mailbox=self.mailbox,
            period=0.1,
            offset=offset,
            update_age=lambda: self.update_age,
            clock=self.clock,
        )
        self.context = self.sender.CreateDefaultContext()
        self.sent: list[lcmt_schunk_wsg_command] = []
        self.lcm.Subscribe(
            "COMMAND", lambda raw: self.sent.append(lcmt_schunk_wsg_command.decode(raw))
        )

    def say(self, width: float, stamp: float = START) -> None:
        message = lcmt_schunk_wsg_status()
        message.utime, message.actual_position_mm = round(1e6 * stamp), 1e3 * width
        self.lcm.Publish("STATUS", message.encode())
        self.lcm.HandleSubscriptions(0)

    def width(self) -> float:
        context = self.simulator.get_mutable_context()
        self.simulator.AdvanceTo(context.get_time() + PERIOD)
        return float(self.receiver.GetOutputPort("width_measured").Eval(context)[0])

    def send(self, width: float | None) -> list[lcmt_schunk_wsg_command]:
        if width is not None:
            self.sender.GetInputPort("width").FixValue(self.context, [width])
        self.sent.clear()
        self.sender.ForcedPublish(self.context)
        self.lcm.HandleSubscriptions(0)
        return self.sent
