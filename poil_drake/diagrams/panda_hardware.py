"""The real Panda behind the same port names as the simulated one."""

import time
from dataclasses import dataclass

from pydrake.lcm import DrakeLcmInterface
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import LcmInterfaceSystem

from poil_drake.systems.panda_lcm import (
    HandCommandSender,
    HandStatusReceiver,
    PandaCommandSender,
    PandaStatusReceiver,
)
from poil_drake.systems.panda_lcm_messages import (
    HAND_PERIOD,
    Clock,
    HandStatus,
    LcmMailbox,
    PandaChannels,
    PandaStatus,
    decode_hand_status,
    decode_panda_status,
)


@dataclass(frozen=True, kw_only=True)
class PandaHardware:
    """The ends of the network that talk to the arm's and the hand's drivers.

    Attributes:
        arm: Where the arm's statuses arrive.
        hand: Where the hand's statuses arrive.
        sender: What commands the arm; its `SendRest` is for the way out.
    """

    arm: LcmMailbox[PandaStatus]
    hand: LcmMailbox[HandStatus]
    sender: PandaCommandSender


def AddPandaHardware(
    *,
    builder: DiagramBuilder,
    lcm: DrakeLcmInterface,
    name: str,
    period: float,
    channels: PandaChannels | None = None,
    clock: Clock = time.time,
) -> PandaHardware:
    """Adds what talks to the Franka drivers, and exports the ports that the simulation has, too.

    With a robot named `panda`, exports the inputs `panda.velocity`, `panda.velocity_time`,
    `hand.width` and the outputs `panda.position_measured`, `panda.velocity_measured`,
    `panda.torque_external`, `panda.status`, `hand.width_measured`. See the systems in
    `poil_drake.systems.panda_lcm` for what they are before the first status.

    Args:
        builder: Gets the systems.
        lcm: The network; its subscriptions are handled between the steps.
        name: The robot's.
        period: The control period [s].
        channels: Where what is said; None for the Franka driver's own.
        clock: The time now [s since the epoch].
    """
    channels = channels or PandaChannels()
    arm = LcmMailbox(lcm, channels.status, decode_panda_status)
    hand = LcmMailbox(lcm, channels.hand_status, decode_hand_status)
    builder.AddNamedSystem("lcm", LcmInterfaceSystem(lcm))
    sender = PandaCommandSender(
        lcm=lcm, channel=channels.command, mailbox=arm, period=period, clock=clock
    )
    hand_sender = HandCommandSender(
        lcm=lcm, channel=channels.hand_command, mailbox=hand, period=HAND_PERIOD, clock=clock
    )
    receiver = PandaStatusReceiver(mailbox=arm, period=period, clock=clock)
    hand_receiver = HandStatusReceiver(mailbox=hand, period=period, clock=clock)
    for system_name, system in (
        ("panda_status", receiver),
        ("hand_status", hand_receiver),
        ("panda_command", sender),
        ("hand_command", hand_sender),
    ):
        builder.AddNamedSystem(system_name, system)
    builder.ExportInput(sender.GetInputPort("velocity"), f"{name}.velocity")
    builder.ExportInput(sender.GetInputPort("velocity_time"), f"{name}.velocity_time")
    builder.ExportInput(hand_sender.GetInputPort("width"), "hand.width")
    for port in ("position_measured", "velocity_measured", "torque_external", "status"):
        builder.ExportOutput(receiver.GetOutputPort(port), f"{name}.{port}")
    builder.ExportOutput(hand_receiver.GetOutputPort("width_measured"), "hand.width_measured")
    return PandaHardware(arm=arm, hand=hand, sender=sender)
