"""A channel on which only one may send."""

from collections import deque

from poil_drake.errors import StationError
from poil_drake.systems.lcm.network import MessageNetwork

_REMEMBERED = 1024
"""Own messages that are told from those of others when they come back: four seconds of them."""


class SharedChannel:
    """Sends on a channel, and hears whether others do.

    Attributes:
        foreign: How many messages of others came.
    """

    def __init__(self, lcm: MessageNetwork, channel: str, *, what: str):
        """Listens from now on; whoever owns `lcm` handles its subscriptions.

        Args:
            lcm: The network.
            channel: The channel's name.
            what: Who is told something there, for the error.
        """
        self.foreign = 0
        self._lcm, self._channel, self._what = lcm, channel, what
        self._own: deque[bytes] = deque(maxlen=_REMEMBERED)
        lcm.Subscribe(channel, self._hear)

    def Send(self, message: bytes) -> None:
        """Sends a message."""
        # The newest first: its echo is what will be heard.
        self._own.appendleft(message)
        self._lcm.Publish(self._channel, message)

    def CheckAlone(self) -> None:
        """Raises a StationError if somebody else has sent anything."""
        if self.foreign:
            raise StationError(
                f"Somebody else commands {self._what} on {self._channel}.",
                remedy="End the other run first; it may be halted in the background.",
            )

    def _hear(self, message: bytes) -> None:
        if message not in self._own:
            self.foreign += 1
