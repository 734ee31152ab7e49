"""The network side of a simulated driver of the Franka hand."""

import time
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import Clock, MessageNetwork
from poil_drake.systems.panda.lcm_messages import (
    HAND_PERIOD,
    HandOpening,
    decode_hand_command,
    encode_hand_status,
)

_STILL = 5e-4
"""A hand that moves less than this in a period has ended its motion [m]."""


class _Hand(NamedTuple):
    """The driver's memory.

    Attributes:
        target: The last commanded opening [m]; NaN before the first command.
        width: Opening at the last update [m]; NaN before the first.
        busy: Whether the hand is moving.
    """

    target: float = np.nan
    width: float = np.nan
    busy: bool = False


class SimulatedHand(LeafSystem):
    """Accepts opening widths from the network and reports the hand's, ten times a second.

    .. pydrake_system::

        name: SimulatedHand
        input_ports:
        - width_measured
        output_ports:
        - width

    Like the real driver it runs one loop at 10 Hz, ignores a command that repeats the last one,
    reads no command while the hand moves, and reports no force. `width` (1,) [m] is the last
    commanded opening, NaN before the first, with which the hand holds its opening.
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
            lcm: The network; its owner handles the subscriptions.
            command_channel: The channel of the commands.
            status_channel: The channel of the statuses.
            clock: The driver's time [s since the epoch].
        """
        super().__init__()
        self._lcm, self._channel, self._clock = lcm, status_channel, clock
        self._mailbox = LcmMailbox(lcm, command_channel, decode_hand_command)
        self._measured = self.DeclareVectorInputPort("width_measured", 1)
        self._state = self.DeclareAbstractState(Value[object](_Hand()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(HAND_PERIOD, 0.0, self._update)
        self.DeclarePeriodicPublishEvent(HAND_PERIOD, 0.0, self._report)
        self.DeclareVectorOutputPort("width", 1, self._calc_width, {self.xa_ticket()})

    def _hand(self, context: Context) -> _Hand:
        return context.get_abstract_state(self._state).get_value()

    def _update(self, context: Context, state: State) -> None:
        before, width = self._hand(context), float(self._measured.Eval(context)[0])
        busy = before.busy and abs(width - before.width) > _STILL
        target, command = before.target, self._mailbox.newest
        if not busy and command is not None and command.width != target:
            target, busy = command.width, True
        state.get_mutable_abstract_state(self._state).set_value(_Hand(target, width, busy))

    def _report(self, context: Context) -> None:
        opening = HandOpening(stamp=self._clock(), width=float(self._measured.Eval(context)[0]))
        self._lcm.Publish(self._channel, encode_hand_status(opening, self._hand(context).busy))

    def _calc_width(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._hand(context).target])
