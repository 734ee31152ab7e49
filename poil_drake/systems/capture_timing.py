"""When a capture happens and when its result is known: simulated, on hardware, or in a replay."""

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Self

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy

_SAME = 1e-6
"""Event times closer than this fraction of a period are the same instant."""

_ROUNDING = 1e-6
"""Recorded times closer than this [s] are the same: far less than any control period."""


@dataclass(frozen=True, eq=False)
class Captured(SharedOnCopy):
    """A capture whose result may still be released. Copies of a context share it.

    Attributes:
        tick: Number of the capture.
        time: When it happened [s].
        result: The future of its result.
    """

    tick: int
    time: float
    result: Future[Any]


Queue = tuple[Captured, ...]
"""Captures in order of time; the last one is always the newest."""


@dataclass(frozen=True, kw_only=True)
class CaptureTiming(ABC):
    """Decides when captures happen and when their results are released.

    It holds no state: the captures so far are its argument.

    Attributes:
        period: Period of the event that may capture [s].
        offset: Time of the first such event [s].
    """

    period: float
    offset: float = 0.0

    @property
    def capture_event(self) -> tuple[float, float]:
        """Period and offset [s] of the event that may capture."""
        return self.period, self.offset

    @property
    @abstractmethod
    def release_event(self) -> tuple[float, float] | None:
        """Period and offset [s] of the event that releases; None: captures release at once."""

    def captures(self, queue: Queue, time: float, *, wanted: bool) -> bool:
        """Returns whether to capture at this event.

        Args:
            queue: The captures so far.
            time: Now [s].
            wanted: Whether the system has something new to capture.
        """
        return wanted

    def added(self, queue: Queue, time: float, result: Future[Any]) -> Queue:
        """Returns the queue after a capture at `time` [s]; drops what will not be released."""
        kept = tuple(entry for entry in queue[:-1] if self._may_be_released(entry, time))
        return (*kept, *queue[-1:], Captured(self._tick(queue, time), time, result))

    def due(self, queue: Queue, time: float) -> Captured | None:
        """Returns the newest capture whose result is due at `time` [s], if any.

        Its result may have to be waited for.
        """
        return next((entry for entry in reversed(queue) if self._is_due(entry, time)), None)

    @abstractmethod
    def _tick(self, queue: Queue, time: float) -> int:
        """Returns the number of a capture at `time` [s] after those in the queue."""

    def _may_be_released(self, entry: Captured, time: float) -> bool:
        """Returns whether a capture before the last two may be released at or after `time` [s]."""
        return False

    @abstractmethod
    def _is_due(self, entry: Captured, time: float) -> bool:
        """Returns whether the result of a capture is to be known at `time` [s]."""


@dataclass(frozen=True, kw_only=True)
class SimulatedDelay(CaptureTiming):
    """Captures every `period`; releases each result exactly `latency` later, and waits for it.

    What is known when does not depend on how fast the work is done.

    Attributes:
        period: Time from one capture to the next [s].
        latency: Time from a capture to its release [s]; it may exceed the period.
        offset: Time of the first capture [s].
    """

    period: float = 1 / 8
    latency: float = 1 / 16

    def __post_init__(self) -> None:
        if not (self.period > 0.0 and self.latency >= 0.0 and self.offset >= 0.0):
            raise InvalidValueError(
                f"The period is {self.period} s, the latency {self.latency} s and the offset "
                f"{self.offset} s.",
                remedy="Give a positive period, and a latency and an offset of 0 or more.",
            )

    @property
    def release_event(self) -> tuple[float, float] | None:
        """See `CaptureTiming`."""
        if self.latency < _SAME * self.period:
            return None
        return self.period, self.offset + self.latency

    def _tick(self, queue: Queue, time: float) -> int:
        return round((time - self.offset) / self.period)

    def _may_be_released(self, entry: Captured, time: float) -> bool:
        # A capture due right now stays: at one instant, captures may run before releases.
        return entry.tick >= self._tick_due(time)

    def _is_due(self, entry: Captured, time: float) -> bool:
        return entry.tick <= self._tick_due(time)

    def _tick_due(self, time: float) -> int:
        return math.floor((time - self.offset - self.latency) / self.period + _SAME)


@dataclass(frozen=True, kw_only=True)
class Worker(CaptureTiming):
    """Captures whenever the last result is ready; releases results as they arrive, never waits.

    For hardware, where the loop must not be delayed: frames that arrive while the worker is busy
    are skipped.

    Attributes:
        period: Time between checks for something new to capture [s].
        offset: Time of the first of these checks [s].
        poll_period: Time between checks for a finished result [s].
    """

    period: float = 1 / 128
    poll_period: float = 1 / 256

    @property
    def release_event(self) -> tuple[float, float]:
        """See `CaptureTiming`."""
        return self.poll_period, 0.0

    def captures(self, queue: Queue, time: float, *, wanted: bool) -> bool:
        """See `CaptureTiming`."""
        return wanted and (not queue or queue[-1].result.done())

    def _tick(self, queue: Queue, time: float) -> int:
        return queue[-1].tick + 1 if queue else 0

    def _is_due(self, entry: Captured, time: float) -> bool:
        return entry.result.done()


@dataclass(frozen=True, kw_only=True)
class RecordedTiming(CaptureTiming):
    """Captures and releases when a recorded run did, however long the work takes now.

    Attributes:
        captured: When each capture happened [s], ascending.
        released: When each result was released [s], ascending, and the number of its capture. Not
            every capture needs a release.
        period: Time between checks whether something is due [s]: the control period.
        offset: Time of captures within that period [s].
    """

    captured: Sequence[float]
    released: Sequence[tuple[float, int]]
    period: float = 1 / 256

    def __post_init__(self) -> None:
        times = [time for time, _ in self.released]
        ascending = list(self.captured) == sorted(self.captured) and times == sorted(times)
        causal = all(
            0 <= tick < len(self.captured) and time >= self.captured[tick] - _ROUNDING
            for time, tick in self.released
        )
        if not ascending or not causal:
            raise InvalidValueError(
                f"A recording of {len(self.captured)} captures and {len(self.released)} releases "
                "is not in order of time, or releases a result before its capture.",
                remedy="Give both in order of time, and the number of the capture with a release.",
            )

    @classmethod
    def of(
        cls,
        captured: Sequence[float],
        released: Sequence[tuple[float, float]],
        *,
        period: float,
        offset: float,
    ) -> Self:
        """Makes the timing from releases given as (time, time of the capture) [s].

        Leaves out releases of unknown captures: a recording may begin late.
        """
        numbered = []
        for time, capture in released:
            tick = bisect_right(captured, capture + _ROUNDING) - 1
            if tick >= 0 and abs(captured[tick] - capture) < _ROUNDING:
                numbered.append((time, tick))
        return cls(captured=tuple(captured), released=tuple(numbered), period=period, offset=offset)

    @property
    def release_event(self) -> tuple[float, float]:
        """See `CaptureTiming`."""
        return self.period, 0.0

    def captures(self, queue: Queue, time: float, *, wanted: bool) -> bool:
        """See `CaptureTiming`; the recording decides, whatever is wanted."""
        return self._tick(queue, time) > (queue[-1].tick if queue else -1)

    def _tick(self, queue: Queue, time: float) -> int:
        """Returns the number of the last capture at or before `time` [s]; -1 before the first."""
        return bisect_right(self.captured, time + _ROUNDING) - 1

    def _may_be_released(self, entry: Captured, time: float) -> bool:
        return any(tick == entry.tick and at > time - _ROUNDING for at, tick in self.released)

    def _is_due(self, entry: Captured, time: float) -> bool:
        index = bisect_right(self.released, (time + _ROUNDING, len(self.captured))) - 1
        return index >= 0 and self.released[index][1] == entry.tick
