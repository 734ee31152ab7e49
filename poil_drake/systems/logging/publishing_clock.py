"""Measures the duration of all publishing in a diagram."""

from collections.abc import Iterable
from contextlib import AbstractContextManager

from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from poil_drake.runtime.stopwatch import Stopwatch

Schedule = tuple[float, float]
"""Period and offset [s] of a periodic publish event."""


class PublishingClock:
    """Measures how long a diagram's publish events take, as "publishing" on a stopwatch.

    At one instant, Drake publishes a diagram's subsystems in the order in which they were added.
    This class adds two systems that publish nothing, one before all other systems and one after
    them. Together they bracket all publish events, even of systems that cannot measure themselves,
    such as Drake's visualizers. The time includes computations that publishing triggers.
    """

    def __init__(self, stopwatch: Stopwatch, schedules: Iterable[Schedule]):
        """Constructs the clock.

        Args:
            stopwatch: Records the durations.
            schedules: The schedules of all publish events in the diagram.
        """
        self._stopwatch, self._schedules = stopwatch, sorted(set(schedules))
        self._running: AbstractContextManager[None] | None = None

    def AddStart(self, builder: DiagramBuilder) -> None:
        """Adds the system that starts the clock. Call this before adding any other system."""
        self._add(builder, "publishing_start", starts=True)

    def AddStop(self, builder: DiagramBuilder) -> None:
        """Adds the system that stops the clock. Call this after adding all other systems."""
        self._add(builder, "publishing_stop", starts=False)

    def _add(self, builder: DiagramBuilder, name: str, *, starts: bool) -> None:
        def publish(context: Context) -> None:
            # Where two schedules coincide, this runs twice.
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
