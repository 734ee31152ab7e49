"""Where the messages of a channel arrive."""

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from poil_drake.errors import InvalidValueError, StationError
from poil_drake.systems.lcm.network import MessageNetwork
from poil_drake.systems.panda.lcm_messages import Clock

_SET_BACK = 10
"""After so many late messages in order their sender's clock counts as set back."""


_CHANGES, _WITHIN = 10, 1.0
"""After so many changes of the sender within so long [s] there are two; one that is started anew
makes one change."""


class Stamped(Protocol):
    """Something with a time."""

    @property
    def stamp(self) -> float:
        """By the sender's clock [s since the epoch]."""


S = TypeVar("S", bound=Stamped)


class LcmMailbox(Generic[S]):
    """Keeps the newest message of a channel; late, doubled and foreign ones are counted only.

    Where many come in order that are all late, with none between that is not, the sender's clock
    was set back: the last of them is the newest then.

    Attributes:
        newest: The one with the newest stamp; None before the first.
        late: Messages whose stamp was not newer than that of one before.
        malformed: Messages that could not be decoded.
        offset: By how much our clock was ahead of the last one's stamp when it came [s], even if
            that was late.
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
        """Subscribes; whoever owns `lcm` handles its subscriptions.

        Args:
            lcm: The network.
            channel: Where the messages come from.
            decode: Reads one; raises an InvalidValueError where it cannot.
            same_sender: Whether the sender of one message may have sent the next one as well.
            clock: The time now [s since the epoch].
        """
        self._decode, self._clock = decode, clock
        self._channel, self._same_sender = channel, same_sender
        self._previous: S | None = None
        self._changes: deque[float] = deque(maxlen=_CHANGES)
        self.offset = math.nan
        self.newest: S | None = None
        self._last, self._in_order = -math.inf, 0
        self.late = self.malformed = 0
        lcm.Subscribe(channel, self._receive)

    def CheckOneSender(self) -> None:
        """Raises a StationError if two senders take turns on the channel."""
        changes = self._changes
        if len(changes) == _CHANGES and changes[-1] - changes[0] <= _WITHIN:
            raise StationError(
                f"Two senders take turns on {self._channel}.",
                remedy="End one of them, such as a forgotten poil driver, or give each robot "
                "channels of its own (poil.hardware.channels).",
            )

    def _receive(self, message: bytes) -> None:
        # What is raised here goes through C.
        try:
            said = self._decode(message)
        except InvalidValueError:
            self.malformed += 1
            return
        self.offset = self._clock() - said.stamp
        if self._previous is not None and not self._same_sender(self._previous, said):
            self._changes.append(time.monotonic())
        self._previous = said
        if self.newest is not None and said.stamp <= self.newest.stamp:
            self.late += 1
            self._in_order = self._in_order + 1 if said.stamp > self._last else 0
            self._last = said.stamp
            if self._in_order < _SET_BACK:
                return
        self.newest, self._last, self._in_order = said, said.stamp, 0
