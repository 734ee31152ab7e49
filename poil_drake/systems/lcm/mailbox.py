"""The two ends of an LCM channel; each detects senders that do not belong there."""

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from poil_drake.errors import InvalidValueError, StationError
from poil_drake.systems.lcm.network import Clock, MessageNetwork

_SET_BACK = 10
"""This many late messages in a row with rising stamps mean that the sender's clock went back."""

_CHANGES, _WITHIN = 10, 1.0
"""This many changes of sender within this time [s] mean two senders; a restart makes one change."""

_REMEMBERED = 1024
"""Number of own messages that a channel recognizes on reception: those of four seconds."""


class Stamped(Protocol):
    """A message with a time stamp."""

    @property
    def stamp(self) -> float:
        """Time by the sender's clock [s since the epoch]."""


S = TypeVar("S", bound=Stamped)


class LcmMailbox(Generic[S]):
    """Keeps the newest message of a channel; counts late and malformed messages.

    A message is late if its stamp is not newer than that of `newest`. Ten consecutive late
    messages, each with a newer stamp than the message before, mean that the sender's clock was set
    back; the last of the ten then becomes `newest`.

    Attributes:
        newest: The newest message; None before the first.
        late: Number of late messages.
        malformed: Number of messages that could not be decoded.
        offset: Time of arrival, by `clock`, minus stamp of the last message, late or not [s];
            NaN before the first message.
    """

    def __init__(
        self,
        lcm: MessageNetwork,
        channel: str,
        decode: Callable[[bytes], S],
        *,
        same_sender: Callable[[S, S], bool] = lambda before, after: True,
        clock: Clock = time.time,
    ):
        """Subscribes to the channel; the owner of `lcm` calls `HandleSubscriptions`.

        Args:
            lcm: The network.
            channel: The channel of the messages.
            decode: Decodes a message, or raises an InvalidValueError.
            same_sender: Returns whether two consecutive messages could be from the same sender.
            clock: Returns the current time [s since the epoch].
        """
        self._decode, self._clock = decode, clock
        self._channel, self._same_sender = channel, same_sender
        self._previous: S | None = None
        self._changes: deque[float] = deque(maxlen=_CHANGES)
        self.offset = math.nan
        self.newest: S | None = None
        self._in_order = 0
        self.late = self.malformed = 0
        lcm.Subscribe(channel, self._receive)

    def CheckOneSender(self) -> None:
        """Raises a StationError if two senders alternate on the channel."""
        changes = self._changes
        if len(changes) == _CHANGES and changes[-1] - changes[0] <= _WITHIN:
            raise StationError(
                f"Two senders alternate on the LCM channel {self._channel}.",
                remedy="Stop one of them, for example a poil driver that is still running, or "
                "set different channels for each robot (poil.hardware.channels).",
            )

    def _receive(self, message: bytes) -> None:
        # An exception from here would pass through C code.
        try:
            decoded = self._decode(message)
        except InvalidValueError:
            self.malformed += 1
            return
        self.offset = self._clock() - decoded.stamp
        previous, self._previous = self._previous, decoded
        if previous is None or self.newest is None:
            self.newest = decoded
            return
        if not self._same_sender(previous, decoded):
            self._changes.append(time.monotonic())
        if decoded.stamp <= self.newest.stamp:
            self.late += 1
            self._in_order = self._in_order + 1 if decoded.stamp > previous.stamp else 0
            if self._in_order < _SET_BACK:
                return
        self.newest, self._in_order = decoded, 0


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
