"""A simulated Franka hand driver's end of the network."""

import time
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import MessageNetwork
from poil_drake.systems.panda.lcm_messages import (
    HAND_PERIOD,
    Clock,
    HandCommand,
    HandStatus,
    decode_hand_command,
    encode_hand_status,
)

_STILL = 5e-4
"""A hand that moves less than this in a period has ended its motion [m]."""


class _Hand(NamedTuple):
    """What the driver remembers.

    Attributes:
        target: Opening that was commanded last [m]; NaN before the first command.
        width: Opening at the last look [m]; NaN before the first.
        busy: Whether the hand is on its way.
    """

    target: float = np.nan
    width: float = np.nan
    busy: bool = False


class SimulatedHand(LeafSystem):
    """Takes opening widths from the network and reports the hand's, ten times a second.

    .. pydrake_system::

        name: SimulatedHand
        input_ports:
        - width_measured
        output_ports:
        - width

    As the real driver does it: one loop of 10 Hz; a command that says the same as the last one is
    ignored, and no other is looked at before the hand has ended its motion; no force is reported.
    `width` (1,) [m] is the opening commanded last, NaN before the first: the hand holds what it
    has then.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        command_channel: str,
        status_channel: str,
        clock: Clock = time.time,
    ):
        """Constructs the driver.

        Args:
            lcm: The network; whoever owns it handles its subscriptions.
            command_channel: Where commands come from.
            status_channel: Where statuses go.
            clock: The driver's time [s since the epoch].
        """
        super().__init__()
        self._lcm, self._channel, self._clock = lcm, status_channel, clock
        self._mailbox: LcmMailbox[HandCommand] = LcmMailbox(
            lcm, command_channel, decode_hand_command
        )
        self._measured = self.DeclareVectorInputPort("width_measured", 1)
        self._state = self.DeclareAbstractState(Value[object](_Hand()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(HAND_PERIOD, 0.0, self._look)
        self.DeclarePeriodicPublishEvent(HAND_PERIOD, 0.0, self._report)
        self.DeclareVectorOutputPort(
            "width", 1, self._calc_width, {self.abstract_state_ticket(self._state)}
        )

    def _hand(self, context: Context) -> _Hand:
        return context.get_abstract_state(self._state).get_value()

    def _look(self, context: Context, state: State) -> None:
        before, width = self._hand(context), float(self._measured.Eval(context)[0])
        busy = before.busy and abs(width - before.width) > _STILL
        target, command = before.target, self._mailbox.newest
        if not busy and command is not None and command.width != target:
            target, busy = command.width, True
        state.get_mutable_abstract_state(self._state).set_value(_Hand(target, width, busy))

    def _report(self, context: Context) -> None:
        width = float(self._measured.Eval(context)[0])
        status = HandStatus(stamp=self._clock(), width=width)
        self._lcm.Publish(self._channel, encode_hand_status(status, self._hand(context).busy))

    def _calc_width(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._hand(context).target])
