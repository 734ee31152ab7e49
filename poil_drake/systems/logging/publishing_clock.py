"""Measures how long publishing takes, whoever publishes."""

from collections.abc import Iterable
from contextlib import AbstractContextManager

from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from poil_drake.runtime.stopwatch import Stopwatch

Schedule = tuple[float, float]
"""Period and offset [s] of a periodic publish event."""


class _End(LeafSystem):
    """Publishes nothing; runs at one end of a diagram's publish events."""

    def __init__(self, clock: "PublishingClock", starts: bool, schedules: Iterable[Schedule]):
        super().__init__()

        def turn(context: Context) -> None:
            clock._turn(starts)

        self.DeclareInitializationPublishEvent(turn)
        for period, offset in schedules:
            self.DeclarePeriodicPublishEvent(period, offset, turn)


class PublishingClock:
    """Times the publish events of a diagram under "publishing" on a stopwatch.

    At one instant Drake lets a diagram's subsystems publish in the order in which they were added.
    Two systems that publish nothing themselves, one added before all others and one after them,
    therefore enclose everything that is published, also by systems that cannot measure themselves,
    such as Drake's visualizers. What publishing has to compute first counts, too.
    """

    def __init__(self, stopwatch: Stopwatch, schedules: Iterable[Schedule]):
        """Makes the clock.

        Args:
            stopwatch: Where to note the durations.
            schedules: When anything in the diagram publishes.
        """
        self._stopwatch, self._schedules = stopwatch, sorted(set(schedules))
        self._running: AbstractContextManager[None] | None = None

    def AddStart(self, builder: DiagramBuilder) -> None:
        """Adds the system that starts the clock: before all others."""
        builder.AddNamedSystem("publishing_start", _End(self, True, self._schedules))

    def AddStop(self, builder: DiagramBuilder) -> None:
        """Adds the system that stops the clock: after all others."""
        builder.AddNamedSystem("publishing_stop", _End(self, False, self._schedules))

    def _turn(self, starts: bool) -> None:
        # Where two schedules meet, each end is told twice.
        if starts and self._running is None:
            self._running = self._stopwatch.measure("publishing")
            self._running.__enter__()
        elif self._running is not None and not starts:
            self._running.__exit__(None, None, None)
            self._running = None
