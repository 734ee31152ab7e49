"""Detects other senders on a channel that belongs to this process."""

from collections import deque

from poil_drake.errors import StationError
from poil_drake.systems.lcm.network import MessageNetwork

_REMEMBERED = 1024
"""Number of own messages that a channel recognizes on reception: those of four seconds."""


class SharedChannel:
    """Sends on a channel, and counts the messages of other senders.

    Attributes:
        foreign: Number of messages from other senders.
    """

    def __init__(self, lcm: MessageNetwork, channel: str, *, what: str):
        """Subscribes to the channel; the owner of `lcm` calls `HandleSubscriptions`.

        Args:
            lcm: The network.
            channel: The channel's name.
            what: The receiver of the messages, for the error.
        """
        self.foreign = 0
        self._lcm, self._channel, self._what = lcm, channel, what
        # The newest first, as its echo is expected next.
        self._own: deque[bytes] = deque(maxlen=_REMEMBERED)
        lcm.Subscribe(channel, self._receive)

    def Send(self, message: bytes) -> None:
        """Sends a message."""
        self._own.appendleft(message)
        self._lcm.Publish(self._channel, message)

    def CheckAlone(self) -> None:
        """Raises a StationError if another sender has sent anything."""
        if self.foreign:
            raise StationError(
                f"Another process commands {self._what} on the LCM channel {self._channel}.",
                remedy="End that process first; it may be suspended in the background.",
            )

    def _receive(self, message: bytes) -> None:
        if message not in self._own:
            self.foreign += 1
