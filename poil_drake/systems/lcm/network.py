"""An LCM network on which no message waits for the one before it to be looked at."""

import math
import select
import time
from collections.abc import Callable
from typing import Any, Protocol

import lcm
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.errors import StationError
from poil_drake.runtime.interpreter_turns import TURNS
from poil_drake.runtime.real_time import RealTimeScheduling


class MessageNetwork(Protocol):
    """What is needed of a network: an `LcmNetwork`, or Drake's `DrakeLcmInterface`."""

    def Publish(self, channel: str, buffer: bytes) -> None:
        """Sends a message."""

    def Subscribe(self, channel: str, handler: Callable[[bytes], None]) -> None:
        """Has messages handled that come from now on; the handler must not raise."""

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        """Has those handled that have come, and returns how many; waits for one at most."""


class LcmNetwork:
    """LCM's own Python interface, with the methods of Drake's.

    Drake's `DrakeLcm` keeps one message of each channel between two looks, the first, and drops
    those that follow; Python cannot tell it otherwise. After a pause it would tell of long ago, and
    whoever else sends on the channel could keep the robot's messages out. Here a channel keeps as
    many as come within a second or two.
    """

    def __init__(self, url: str, *, queue_capacity: int = 2048, realtime_priority: int = 0):
        """Opens the network.

        Args:
            url: As LCM spells it, e.g. udpm://239.255.76.67:7667?ttl=0.
            queue_capacity: How many messages of a channel wait to be handled.
            realtime_priority: Of LCM's thread that receives, see `RealTimeScheduling`.

        Raises:
            StationError: if it cannot be opened.
        """
        self._capacity = queue_capacity
        self._subscriptions: list[Any] = []
        try:
            self._lcm = lcm.LCM(url)
            with RealTimeScheduling(realtime_priority, inherited=True):
                self._lcm.fileno()  # LCM starts its thread when it is first needed.
        except (RuntimeError, OSError) as error:
            raise StationError(
                f"The LCM network '{url}' cannot be opened ({error}).",
                remedy="Write e.g. udpm://239.255.76.67:7667?ttl=0, and see that multicast has a "
                "route: poil doctor tries it.",
            ) from error

    def Publish(self, channel: str, buffer: bytes) -> None:
        """See `MessageNetwork`."""
        self._lcm.publish(channel, buffer)

    def Subscribe(self, channel: str, handler: Callable[[bytes], None]) -> None:
        """See `MessageNetwork`."""
        subscription = self._lcm.subscribe(channel, lambda _, message: handler(message))
        subscription.set_queue_capacity(self._capacity)
        self._subscriptions.append(subscription)

    def Close(self) -> None:
        """Has no more messages kept: from now on nobody looks at them."""
        while self._subscriptions:
            self._lcm.unsubscribe(self._subscriptions.pop())

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        """See `MessageNetwork`.

        Who waits for messages has time, and takes them in its turn (see `InterpreterTurns`).
        """
        if timeout_millis > 0:
            select.select([self._lcm.fileno()], [], [], 1e-3 * timeout_millis)
            TURNS.wait()
        count = 0
        # Not for ever, however much comes.
        while count < self._capacity and self._lcm.handle_timeout(0):
            count += 1
        return count


class LcmPump(LeafSystem):
    """Has a network's messages handled, right before a period's updates.

    .. pydrake_system::

        name: LcmPump

    It does so in an unrestricted update, and Drake lets those of one instant happen in the order in
    which systems were added: to be added before all that look at what has arrived.

    Attributes:
        handled_at: When it did so last [s], by `time.monotonic`.
    """

    def __init__(self, *, network: MessageNetwork, period: float):
        """Constructs the pump.

        Args:
            network: Whose messages.
            period: Between two looks [s].
        """
        super().__init__()
        self.handled_at = -math.inf
        self._network = network
        self.DeclareAbstractState(Value(0))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._pump)

    def _pump(self, context: Context, state: State) -> None:
        self.handled_at = time.monotonic()
        self._network.HandleSubscriptions(0)
