"""The systems that communicate with the real Panda; their ports match the simulated Panda's."""

import time
from dataclasses import dataclass

from pydrake.systems.framework import DiagramBuilder

from poil_drake.diagrams.station.exports import COMMANDS, MEASUREMENTS, ExportPorts
from poil_drake.diagrams.station.hardware.hardware_schedule import COMMAND_SHARE
from poil_drake.robots.velocity_limiter import VelocityLimiter
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import Clock, LcmPump, MessageNetwork
from poil_drake.systems.lcm.panda_messages import (
    HAND_PERIOD,
    HandOpening,
    PandaChannels,
    PandaStatus,
    decode_hand_status,
    decode_panda_status,
    same_panda,
)
from poil_drake.systems.lcm.panda_receivers import FrankaStatusReceiver, HandStatusReceiver
from poil_drake.systems.lcm.panda_senders import FrankaCommandSender, HandCommandSender
from poil_drake.systems.panda.kinematic_robot import KinematicRobot


@dataclass(frozen=True, kw_only=True)
class PandaHardware:
    """The endpoints that communicate with the Franka drivers of the arm and the hand.

    Attributes:
        arm: Receives the arm's statuses.
        hand: Receives the hand's statuses.
        sender: Commands the arm, and brings it to rest at shutdown. None in a dry run.
        hand_sender: Commands the hand. None in a dry run.
    """

    arm: LcmMailbox[PandaStatus]
    hand: LcmMailbox[HandOpening]
    sender: FrankaCommandSender | None
    hand_sender: HandCommandSender | None


def AddPandaHardware(
    *,
    builder: DiagramBuilder,
    lcm: MessageNetwork,
    name: str,
    period: float,
    limiter: VelocityLimiter,
    channels: PandaChannels | None = None,
    dry_run: bool = False,
    expiry: float = 0.1,
    stall_limit: float = 0.08,
    clock: Clock = time.time,
    time_scale: float = 1.0,
) -> PandaHardware:
    """Adds the systems that talk to the Franka drivers, and exports the ports of an arm and a hand.

    For a robot named `panda`, exports the inputs `panda.velocity`, `panda.velocity_time`,
    `hand.width` and the outputs `panda.position_measured`, `panda.velocity_measured`,
    `panda.torque_external`, `panda.status`, `hand.width_measured`. See the systems in
    `poil_drake.systems.lcm.panda_receivers` for the outputs before the first status.

    Args:
        builder: Receives the systems.
        lcm: The network. The diagram handles its subscriptions once per period.
        name: The robot's name.
        period: The control period [s].
        limiter: Computes how the arm brakes; must have the same period.
        channels: Names of the LCM channels; None for those of the Franka driver.
        dry_run: Whether to send nothing. Commands then move a `KinematicRobot`, which starts at the
            real robot's posture, and the ports export that robot's measurements.
        expiry: How long the driver follows a command [s].
        stall_limit: Time since the last update, by `clock` [s], after which no command is sent.
        clock: Returns the current time [s since the epoch].
        time_scale: Seconds by `clock` per second of real time.
    """
    channels = channels or PandaChannels()
    arm = LcmMailbox(lcm, channels.status, decode_panda_status, same_sender=same_panda, clock=clock)
    hand = LcmMailbox(lcm, channels.hand_status, decode_hand_status, clock=clock)
    pump = builder.AddNamedSystem("lcm", LcmPump(network=lcm, period=period))
    receiver = builder.AddNamedSystem(
        "panda_status", FrankaStatusReceiver(mailbox=arm, period=period, clock=clock)
    )
    hand_receiver = builder.AddNamedSystem(
        "hand_status", HandStatusReceiver(mailbox=hand, period=period, clock=clock)
    )
    if dry_run:
        _add_kinematic_robot(builder, name, period, receiver, hand_receiver)
        return PandaHardware(arm=arm, hand=hand, sender=None, hand_sender=None)

    def outdated() -> bool:
        return time_scale * (time.monotonic() - pump.handled_at) > stall_limit

    # After the update: nothing may be sent while a simulator is being initialized.
    offset = COMMAND_SHARE * period
    sender = builder.AddNamedSystem(
        "panda_command",
        FrankaCommandSender(
            lcm=lcm,
            channel=channels.command,
            mailbox=arm,
            limiter=limiter,
            period=period,
            offset=offset,
            expiry=expiry,
            outdated=outdated,
            clock=clock,
            time_scale=time_scale,
        ),
    )
    hand_sender = builder.AddNamedSystem(
        "hand_command",
        HandCommandSender(
            lcm=lcm,
            channel=channels.hand_command,
            mailbox=hand,
            period=HAND_PERIOD,
            offset=offset,
            outdated=outdated,
            clock=clock,
        ),
    )
    ExportPorts(builder, sender, COMMANDS, name)
    ExportPorts(builder, hand_sender, ["width"], "hand")
    ExportPorts(builder, receiver, [*MEASUREMENTS, "status"], name)
    ExportPorts(builder, hand_receiver, ["width_measured"], "hand")
    return PandaHardware(arm=arm, hand=hand, sender=sender, hand_sender=hand_sender)


def _add_kinematic_robot(
    builder: DiagramBuilder,
    name: str,
    period: float,
    receiver: FrankaStatusReceiver,
    hand_receiver: HandStatusReceiver,
) -> None:
    robot = builder.AddNamedSystem("kinematic_robot", KinematicRobot(period=period))
    position = receiver.GetOutputPort("position_measured")
    width = hand_receiver.GetOutputPort("width_measured")
    builder.Connect(position, robot.GetInputPort("real_position"))
    builder.Connect(width, robot.GetInputPort("real_width"))
    ExportPorts(builder, robot, [*COMMANDS, *MEASUREMENTS], name)
    ExportPorts(builder, receiver, ["status"], name)
    ExportPorts(builder, robot, ["width", "width_measured"], "hand")
