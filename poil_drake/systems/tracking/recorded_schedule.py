"""When what was captured became known in a run that is replayed."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from poil_drake.errors import InvalidValueError
from poil_drake.systems.tracking.release_schedule import Captured

_ROUNDING = 1e-6
"""Two times that differ by less [s] are the same: far less than any control period."""


@dataclass(frozen=True, kw_only=True)
class RecordedSchedule:
    """Captures and releases at the times of a recording; see `ReleaseSchedule`.

    Attributes:
        captures: When each capture happened [s], ascending.
        releases: When what each capture gave was released [s], ascending, and the number of that
            capture. Not every capture needs a release.
    """

    captures: Sequence[float]
    releases: Sequence[tuple[float, int]]

    def __post_init__(self) -> None:
        times = [time for time, _ in self.releases]
        ascending = list(self.captures) == sorted(self.captures) and times == sorted(times)
        causal = all(
            0 <= tick < len(self.captures) and time >= self.captures[tick] - _ROUNDING
            for time, tick in self.releases
        )
        if not ascending or not causal:
            raise InvalidValueError(
                f"A schedule of {len(self.captures)} captures and {len(self.releases)} releases is "
                "not in order of time, or releases what was not captured yet.",
                remedy="Give both in order of time, and the number of the capture with a release.",
            )

    @classmethod
    def of(cls, captures: Sequence[float], releases: Sequence[tuple[float, float]]) -> Self:
        """Returns the schedule of captures, and of releases (time, time of the capture) [s].

        A release of what was not captured, such as a recording has where it begins late, is left
        out.
        """
        numbered = []
        for time, captured in releases:
            tick = bisect_right(captures, captured + _ROUNDING) - 1
            if tick >= 0 and abs(captures[tick] - captured) < _ROUNDING:
                numbered.append((time, tick))
        return cls(captures=tuple(captures), releases=tuple(numbered))

    def capture_tick(self, time: float) -> int:
        """Returns the number of the last capture at or before `time` [s]; -1 before the first."""
        return bisect_right(self.captures, time + _ROUNDING) - 1

    def added(self, queue: tuple[Captured, ...], time: float, item: Any) -> tuple[Captured, ...]:
        """Returns the queue after the capture of `item` at `time` [s].

        What is released at `time` or later stays in the queue; so does the last capture.
        """
        awaited = {tick for released, tick in self.releases if released > time - _ROUNDING}
        kept = tuple(entry for entry in queue[:-1] if entry.tick in awaited) + queue[-1:]
        return (*kept, Captured(self.capture_tick(time), item))

    def due(self, queue: tuple[Captured, ...], time: float) -> Captured | None:
        """Returns what was released last at `time` [s]; None if it is not in the queue."""
        index = bisect_right(self.releases, (time + _ROUNDING, len(self.captures))) - 1
        if index < 0:
            return None
        tick = self.releases[index][1]
        return next((entry for entry in queue if entry.tick == tick), None)
