"""Measures the duration of all publishing in a diagram."""

from collections.abc import Iterable
from contextlib import AbstractContextManager

from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from poil_drake.runtime.stopwatch import Stopwatch

Schedule = tuple[float, float]
"""Period and offset [s] of a periodic publish event."""


class PublishingClock:
    """Times the publish events of a diagram under "publishing" on a stopwatch.

    At one instant, Drake publishes a diagram's subsystems in the order in which they were added.
    Two systems that publish nothing, one added before all others and one after them, therefore
    enclose everything that is published, also by systems that cannot measure themselves, such as
    Drake's visualizers. The computations that publishing triggers count, too.
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
        self._add(builder, "publishing_start", starts=True)

    def AddStop(self, builder: DiagramBuilder) -> None:
        """Adds the system that stops the clock: after all others."""
        self._add(builder, "publishing_stop", starts=False)

    def _add(self, builder: DiagramBuilder, name: str, *, starts: bool) -> None:
        def publish(context: Context) -> None:
            # Where two schedules meet, this runs twice.
            if starts and self._running is None:
                self._running = self._stopwatch.measure("publishing")
                self._running.__enter__()
            elif self._running is not None and not starts:
                self._running.__exit__(None, None, None)
                self._running = None

        system = builder.AddNamedSystem(name, LeafSystem())
        system.DeclareInitializationPublishEvent(publish)
        for period, offset in self._schedules:
            system.DeclarePeriodicPublishEvent(period, offset, publish)
