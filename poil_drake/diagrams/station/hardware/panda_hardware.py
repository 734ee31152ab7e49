"""The systems that communicate with the real Panda; their ports match the simulated Panda's."""

import time
from dataclasses import dataclass
from typing import Any

from pydrake.systems.framework import DiagramBuilder

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station_base import COMMANDS, MEASUREMENTS, ExportPorts
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.velocity_limiter import VelocityLimiter
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import Clock, LcmPump, MessageNetwork
from poil_drake.systems.lcm.panda_messages import (
    HAND_PERIOD,
    HandOpening,
    PandaStatus,
    decode_hand_status,
    decode_panda_status,
    same_panda,
)
from poil_drake.systems.lcm.panda_receivers import FrankaStatusReceiver, HandStatusReceiver
from poil_drake.systems.lcm.panda_senders import FrankaCommandSender, HandCommandSender
from poil_drake.systems.panda.kinematic_robot import KinematicRobot

COMMAND_SHARE = 3 / 4
"""Fraction of the control period after which the command goes out.

When a period begins, messages are handled and the command is computed; this nearly always ends
before the command is due. `RealTimeLoop` waits until then. Afterwards, images are captured and
signals are logged.
"""

_DAYS = 1e6
"""Clocks that differ by more than this [s] have different time scales."""


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
    scenario: Scenario,
    dry_run: bool,
    clock: Clock,
) -> PandaHardware:
    """Adds the systems that talk to the Franka drivers, and exports the ports of an arm and a hand.

    For a robot named `panda`, exports the inputs `panda.velocity`, `panda.velocity_time`,
    `hand.width` and the outputs `panda.position_measured`, `panda.velocity_measured`,
    `panda.torque_external`, `panda.status`, `hand.width_measured`. See the systems in
    `poil_drake.systems.lcm.panda_receivers` for the outputs before the first status.

    Args:
        builder: Receives the systems.
        lcm: The network. The diagram handles its subscriptions once per control period.
        scenario: Names the robot, and sets the control period, the limits and the connection.
        dry_run: Whether to send nothing. Commands then move a `KinematicRobot`, which starts at the
            real robot's posture, and the ports export that robot's measurements.
        clock: Returns the current time [s since the epoch], `time_scale` as fast as real time.
    """
    poil, hardware = scenario.poil, scenario.poil.hardware
    name, period, channels = poil.robot, poil.rates.control, hardware.channels
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
        robot = builder.AddNamedSystem("kinematic_robot", KinematicRobot(period=period))
        position = receiver.GetOutputPort("position_measured")
        width = hand_receiver.GetOutputPort("width_measured")
        builder.Connect(position, robot.GetInputPort("real_position"))
        builder.Connect(width, robot.GetInputPort("real_width"))
        ExportPorts(builder, robot, [*COMMANDS, *MEASUREMENTS], name)
        ExportPorts(builder, receiver, ["status"], name)
        ExportPorts(builder, robot, ["width", "width_measured"], "hand")
        return PandaHardware(arm=arm, hand=hand, sender=None, hand_sender=None)

    def outdated() -> bool:
        age = hardware.time_scale * (time.monotonic() - pump.handled_at)
        return age > poil.safety.stall_limit

    # After the update: nothing may be sent while a simulator is being initialized.
    offset = COMMAND_SHARE * period
    sender = builder.AddNamedSystem(
        "panda_command",
        FrankaCommandSender(
            lcm=lcm,
            channel=channels.command,
            mailbox=arm,
            limiter=VelocityLimiter(
                limits=PandaModel().joint_limits, period=period, config=poil.safety.limiter
            ),
            period=period,
            offset=offset,
            expiry=hardware.command_expiry,
            outdated=outdated,
            clock=clock,
            time_scale=hardware.time_scale,
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


def MailboxProblems(mailbox: LcmMailbox[Any], channel: str, tolerance: float) -> list[str]:
    """Returns the problems with the messages of a channel, one clause each.

    Args:
        mailbox: Receives the channel's messages.
        channel: The channel's name.
        tolerance: Largest allowed difference of the sender's clock from the mailbox's [s].
    """
    found = []
    if mailbox.malformed:
        found.append(f"{mailbox.malformed} messages on {channel} could not be read")
    if mailbox.late:
        found.append(f"{mailbox.late} messages on {channel} arrived late or twice")
    if abs(mailbox.offset) > _DAYS:
        found.append(
            f"the messages on {channel} are stamped by a different clock: do their sender and this "
            "program have the same --time-scale?"
        )
    elif abs(mailbox.offset) > tolerance:
        side = "before" if mailbox.offset > 0.0 else "after"
        found.append(
            f"the last message on {channel} was stamped {abs(mailbox.offset):.2f} s {side} it "
            "arrived: are the clocks synchronized?"
        )
    return found
