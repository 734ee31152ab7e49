"""An LCM network that queues all messages, and a system that handles them."""

import math
import select
import time
from collections.abc import Callable
from typing import Any, Protocol

import lcm
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.errors import InvalidValueError, StationError
from poil_drake.runtime.interpreter_turns import TURNS
from poil_drake.runtime.real_time import RealTimeScheduling
from poil_drake.systems.control_period import CONTROL_PERIOD

Clock = Callable[[], float]
"""A function that returns the current time [s since the epoch]."""

_LONGEST_CHANNEL = 63
"""LCM's own limit on channel names [bytes]."""


def check_channel(name: str, key: str) -> None:
    """Checks that LCM accepts the name of a channel.

    Args:
        name: The channel's name.
        key: The setting that holds the name, for the error.

    Raises:
        InvalidValueError: if LCM does not accept the name.
    """
    if not 0 < len(name.encode()) <= _LONGEST_CHANNEL:
        raise InvalidValueError(
            f"{key} is '{name}', which is not a valid LCM channel name.",
            remedy=f"Use 1 to {_LONGEST_CHANNEL} ASCII characters.",
        )


class MessageNetwork(Protocol):
    """The interface that `LcmNetwork` and Drake's `DrakeLcmInterface` have in common."""

    def Publish(self, channel: str, buffer: bytes) -> None:
        """Sends a message."""

    def Subscribe(self, channel: str, handler: Callable[[bytes], None]) -> None:
        """Makes `HandleSubscriptions` call `handler` for each message; `handler` must not raise."""

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        """Waits up to the timeout [ms] for a message, handles all, and returns their number."""


class LcmNetwork:
    """A network through LCM's own Python interface, with methods named like those of `DrakeLcm`.

    Between two calls of `HandleSubscriptions`, `DrakeLcm` keeps only the first message of each
    channel, and its Python interface cannot change that. After a pause this message is old, and a
    second sender on the channel can crowd out the robot. Here each channel has a queue that holds
    the messages of one or two seconds.
    """

    def __init__(self, url: str, *, queue_capacity: int = 2048, realtime_priority: int = 0):
        """Opens the network.

        Args:
            url: The network's URL in LCM's syntax, e.g. udpm://239.255.76.67:7667?ttl=0.
            queue_capacity: Largest number of messages that wait in the queue of a channel.
            realtime_priority: Priority of LCM's receive thread, see `RealTimeScheduling`.

        Raises:
            StationError: if the network cannot be opened.
        """
        self._capacity = queue_capacity
        self._subscriptions: list[Any] = []
        try:
            self._lcm = lcm.LCM(url)
            with RealTimeScheduling(realtime_priority, inherited=True):
                self._lcm.fileno()  # The first use starts LCM's receive thread.
        except (RuntimeError, OSError) as error:
            raise StationError(
                f"The LCM network '{url}' cannot be opened ({error}).",
                remedy="Use a URL such as udpm://239.255.76.67:7667?ttl=0, and add a route for "
                "multicast; poil doctor shows how.",
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
        """Ends all subscriptions, and drops the messages in their queues."""
        while self._subscriptions:
            self._lcm.unsubscribe(self._subscriptions.pop())

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        """See `MessageNetwork`.

        If the timeout is positive, the call also waits its turn (see `InterpreterTurns.wait`).
        """
        if timeout_millis > 0:
            select.select([self._lcm.fileno()], [], [], 1e-3 * timeout_millis)
            TURNS.wait()
        count = 0
        # The bound ends the loop under any load.
        while count < self._capacity and self._lcm.handle_timeout(0):
            count += 1
        return count


class LcmPump(LeafSystem):
    """Handles a network's messages right before the updates of each period.

    .. pydrake_system::

        name: LcmPump

    The pump uses an unrestricted update. Drake runs the unrestricted updates of one instant in the
    order in which their systems were added, so add the pump before all systems that read messages.

    Attributes:
        handled_at: When the messages were last handled [s], by `time.monotonic`.
    """

    def __init__(self, *, network: MessageNetwork, period: float = CONTROL_PERIOD):
        """Constructs the pump.

        Args:
            network: The network.
            period: Time between two updates [s].
        """
        super().__init__()
        self.handled_at = -math.inf
        self._network = network
        self.DeclareAbstractState(Value(0))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._pump)

    def _pump(self, context: Context, state: State) -> None:
        self.handled_at = time.monotonic()
        self._network.HandleSubscriptions(0)
