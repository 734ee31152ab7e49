"""The network side of a simulated driver of the Franka hand."""

import time

import numpy as np
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import Clock, MessageNetwork
from poil_drake.systems.lcm.panda_messages import (
    HAND_PERIOD,
    HandOpening,
    PandaChannels,
    decode_hand_command,
    encode_hand_status,
)

_STILL = 5e-4
"""A hand that moves less than this in a period has ended its motion [m]."""


class SimulatedHand(LeafSystem):
    """Accepts opening commands over the network and reports the opening ten times a second.

    .. pydrake_system::

        name: SimulatedHand
        input_ports:
        - width_measured
        output_ports:
        - width

    Like the real driver it runs one loop at 10 Hz, ignores a command that repeats the last one,
    reads no command while the hand moves, and reports no force. `width` (1,) [m] is the last
    commanded opening; before the first command it is NaN, and the hand holds its opening.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        command_channel: str = PandaChannels.hand_command,
        status_channel: str = PandaChannels.hand_status,
        clock: Clock = time.time,
    ):
        """Constructs the driver.

        Args:
            lcm: The network; its owner calls `HandleSubscriptions`.
            command_channel: The channel of the commands.
            status_channel: The channel of the statuses.
            clock: The driver's time [s since the epoch].
        """
        super().__init__()
        self._lcm, self._channel, self._clock = lcm, status_channel, clock
        self._mailbox = LcmMailbox(lcm, command_channel, decode_hand_command)
        self._measured = self.DeclareVectorInputPort("width_measured", 1)
        self._target = self.DeclareDiscreteState([np.nan])
        self.DeclareStateOutputPort("width", self._target)
        # The measured opening at the last update [m], and 1 while the hand is moving.
        self._last = self.DeclareDiscreteState([np.nan, 0.0])
        self.DeclarePeriodicUnrestrictedUpdateEvent(HAND_PERIOD, 0.0, self._update)
        self.DeclarePeriodicPublishEvent(HAND_PERIOD, 0.0, self._report)

    def _update(self, context: Context, state: State) -> None:
        discrete_state, command = state.get_mutable_discrete_state(), self._mailbox.newest
        width = self._measured.Eval(context)[0]
        last_width, moving = discrete_state.value(self._last)
        busy = bool(moving) and abs(width - last_width) > _STILL
        target = discrete_state.value(self._target)[0]
        if not busy and command is not None and command.width != target:
            discrete_state.set_value(self._target, [command.width])
            busy = True
        discrete_state.set_value(self._last, [width, float(busy)])

    def _report(self, context: Context) -> None:
        opening = HandOpening(stamp=self._clock(), width=float(self._measured.Eval(context)[0]))
        busy = bool(context.get_discrete_state(self._last)[1])
        self._lcm.Publish(self._channel, encode_hand_status(opening, busy))
