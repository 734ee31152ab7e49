"""When what was captured becomes known: a sensor's rate and latency, as pure bookkeeping."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from poil_drake.errors import InvalidValueError

# Event times that differ by less than this fraction of a period are the same instant.
_SAME = 1e-6


class Captured(NamedTuple):
    """Something captured and not yet forgotten.

    Attributes:
        tick: Number of the capture, counted from the first.
        item: What came of it.
    """

    tick: int
    item: Any


@dataclass(frozen=True, kw_only=True)
class ReleaseSchedule:
    """Captures happen every `period`; each is released `latency` after it.

    Attributes:
        period: Time from one capture to the next [s].
        latency: Time from a capture to its release [s]; it may exceed the period.
        offset: Time of the first capture [s].
    """

    period: float
    latency: float
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not (self.period > 0.0 and self.latency >= 0.0 and self.offset >= 0.0):
            raise InvalidValueError(
                f"The period is {self.period} s, the latency {self.latency} s and the offset "
                f"{self.offset} s.",
                remedy="Give a positive period, and a latency and an offset of 0 or more.",
            )

    @property
    def immediate(self) -> bool:
        """Whether a release is at the instant of its capture, but for rounding."""
        return self.latency < _SAME * self.period

    def capture_tick(self, time: float) -> int:
        """Returns the number of the capture at `time` [s]."""
        return round((time - self.offset) / self.period)

    def release_time(self, tick: int) -> float:
        """Returns when what the capture of that number gave is released [s]."""
        return self.offset + tick * self.period + self.latency

    def added(self, queue: tuple[Captured, ...], time: float, item: Any) -> tuple[Captured, ...]:
        """Returns the queue after the capture of `item` at `time` [s].

        Whatever is released at `time` or later stays in the queue, so that it does not matter in
        which order a capture and a release of one instant are handled; so does the last capture.
        """
        oldest = math.floor((time - self.offset - self.latency) / self.period + _SAME)
        kept = tuple(entry for entry in queue[:-1] if entry.tick >= oldest) + queue[-1:]
        return (*kept, Captured(self.capture_tick(time), item))

    def due(self, queue: tuple[Captured, ...], time: float) -> Captured | None:
        """Returns what is released at `time` [s], None if nothing was captured for it."""
        tick = self.capture_tick(time - self.latency)
        return next((entry for entry in queue if entry.tick == tick), None)
