"""Decides when captures happen and results are released, for simulation, hardware and replay."""

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy

_SAME = 1e-6
"""Event times closer than this fraction of a period are the same instant."""

_ROUNDING = 1e-6
"""Recorded times closer than this [s] are the same instant."""


@dataclass(frozen=True, eq=False)
class Captured(SharedOnCopy):
    """A capture whose result may still be released. Copies of a context share this object.

    Attributes:
        tick: Number of the capture.
        time: When the capture happened [s].
        result: The future of the result.
    """

    tick: int
    time: float
    result: Future[Any]


class Queue(tuple[Captured, ...], SharedOnCopy):
    """The newest captures, including all that may still be released, in order of time."""


@dataclass(frozen=True, kw_only=True)
class CaptureTiming(ABC):
    """Decides when captures happen and when their results are released.

    It holds no state: its methods take the queue of captures.

    Attributes:
        period: Period of the events at which a capture may happen [s].
        offset: Time of the first of these events [s].
    """

    period: float
    offset: float = 0.0

    @property
    @abstractmethod
    def release_event(self) -> tuple[float, float] | None:
        """Period and offset [s] of the release events; None if results are released at capture."""

    def captures(self, queue: Queue, time: float, *, wanted: bool) -> bool:
        """Returns whether to capture at this event.

        Args:
            queue: The captures before this event.
            time: The current time [s].
            wanted: Whether the system has something new to capture.
        """
        return wanted

    def added(self, queue: Queue, time: float, result: Future[Any]) -> Queue:
        """Returns the queue with a new capture at `time` [s], whose work has the future `result`.

        Drops the captures before the one that is due at `time`: they will never be released.
        """
        due = self.due(queue, time)
        kept = queue if due is None else queue[queue.index(due) :]
        return Queue((*kept, Captured(self._tick(queue, time), time, result)))

    def due(self, queue: Queue, time: float) -> Captured | None:
        """Returns the newest capture whose result is due at `time` [s], or None.

        The result may be due before it is ready.
        """
        return next((entry for entry in reversed(queue) if self._is_due(entry, time)), None)

    @abstractmethod
    def _tick(self, queue: Queue, time: float) -> int:
        """Returns the number of a new capture at `time` [s], given the queue of earlier ones."""

    @abstractmethod
    def _is_due(self, entry: Captured, time: float) -> bool:
        """Returns whether the result of a capture is due for release at `time` [s]."""


@dataclass(frozen=True, kw_only=True)
class SimulatedDelay(CaptureTiming):
    """Captures every `period`; releases each result exactly `latency` later.

    A release waits for its result, so the timing does not depend on how fast the work is done.

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
                f"SimulatedDelay has period={self.period} s, latency={self.latency} s and offset="
                f"{self.offset} s, of which at least one is out of range.",
                remedy="Set a positive period, and a latency and an offset of at least 0 s.",
            )

    @property
    def release_event(self) -> tuple[float, float] | None:
        """See `CaptureTiming`."""
        if self.latency < _SAME * self.period:
            return None
        return self.period, self.offset + self.latency

    def _tick(self, queue: Queue, time: float) -> int:
        return round((time - self.offset) / self.period)

    def _is_due(self, entry: Captured, time: float) -> bool:
        tick = math.floor((time - self.offset - self.latency) / self.period + _SAME)
        return entry.tick <= tick


@dataclass(frozen=True, kw_only=True)
class Worker(CaptureTiming):
    """Captures only once the last result is ready; releases results when ready; never waits.

    It suits hardware, where the loop must not be delayed. Frames that arrive while the work is in
    progress are skipped.

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
    """Captures and releases at the times of a recorded run, however long the work takes now.

    Attributes:
        captured: When each capture happened [s], ascending.
        released: (time of the release, time of its capture) [s], in order of release. A capture
            may have no release. A release whose capture is not in `captured`, e.g. because it
            preceded the recording, has no effect.
        period: Time between checks for a due capture or release [s]: the control period.
        offset: Time of the first check for a capture [s]; checks for releases start at 0.
    """

    captured: Sequence[float]
    released: Sequence[tuple[float, float]]
    period: float = 1 / 256

    def __post_init__(self) -> None:
        for time, capture in self.released:
            if time < capture - _ROUNDING:
                raise InvalidValueError(
                    f"The release at {time} s precedes its capture at {capture} s.",
                    remedy="Pass releases that follow their captures.",
                )

    @property
    def release_event(self) -> tuple[float, float]:
        """See `CaptureTiming`."""
        return self.period, 0.0

    def captures(self, queue: Queue, time: float, *, wanted: bool) -> bool:
        """See `CaptureTiming.captures`. The recording alone decides; `wanted` is ignored."""
        return self._tick(queue, time) > (queue[-1].tick if queue else -1)

    def _tick(self, queue: Queue, time: float) -> int:
        """Returns the number of the last capture at or before `time` [s]; -1 before the first."""
        return bisect_right(self.captured, time + _ROUNDING) - 1

    def _is_due(self, entry: Captured, time: float) -> bool:
        index = bisect_right(self.released, (time + _ROUNDING, math.inf)) - 1
        return index >= 0 and (abs(self.released[index][1] - self.captured[entry.tick]) < _ROUNDING)
