"""Periodic work of a system: a capture starts the work, and a later release shows its result."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.runtime.background_thread import Background
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.capture_timing import Captured, CaptureTiming, Queue

Work = Callable[[], Any]


class CaptureAndRelease:
    """Adds periodic work to a system, at the times that a `CaptureTiming` decides.

    A capture starts work, and a later release shows its result. Captures and releases are
    unrestricted updates. All state is in the context.

    Attributes:
        tickets: The prerequisites of output ports that use `result` or `capture_time`.
    """

    def __init__(
        self,
        *,
        system: LeafSystem,
        timing: CaptureTiming,
        nothing: Any,
        begin: Callable[[Context, State, Captured | None], Work | None],
        wanted: Callable[[Context, Captured | None], bool] = lambda context, previous: True,
        thread: str | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        """Declares the state and events on a system.

        Args:
            system: Receives the state and events.
            timing: When to capture and when to release.
            nothing: The result before the first release.
            begin: Called at a capture with the context, the state to update and the previous
                capture, if any. Copies what the work needs and returns the work, a function without
                arguments; None if there is nothing to capture.
            wanted: Returns whether there is something new to capture, given the context and the
                previous capture, if any.
            thread: Name of the thread that does the work; None: the work is done at the capture.
            stopwatch: Records the time spent waiting for results ("waiting").
        """
        self._timing, self._begin, self._wanted = timing, begin, wanted
        self._stopwatch = stopwatch or Stopwatch()
        self._background = None if thread is None else Background(thread)
        self._queue = system.DeclareAbstractState(Value[object](Queue()))
        before = Captured(-1, -np.inf, _done(nothing))
        self._released = system.DeclareAbstractState(Value(before))
        self._times = system.DeclareDiscreteState(np.full(3, -np.inf))
        self.tickets: set[Any] = {system.abstract_state_ticket(self._released)}
        self._system = system
        system.DeclarePeriodicUnrestrictedUpdateEvent(timing.period, timing.offset, self._capture)
        if timing.release_event is not None:
            system.DeclarePeriodicUnrestrictedUpdateEvent(*timing.release_event, self._release)

    def result(self, context: Context) -> Any:
        """Returns the last released result; before the first, the constructor's `nothing`."""
        return context.get_abstract_state(self._released).get_value().result.result()

    def capture_time(self, context: Context) -> float:
        """Returns the capture time [s] of `result`; minus infinity before the first release."""
        return context.get_abstract_state(self._released).get_value().time

    def DeclareTimesPort(self) -> None:
        """Declares the output port `times` (3,) [s].

        Its elements are the time of the last capture, the time of the last release, and the capture
        time of the last released result. Each is minus infinity until it is known.
        """
        self._system.DeclareStateOutputPort("times", self._times)

    def close(self) -> None:
        """Finishes the work in progress, cancels queued work and ends the thread.

        Later captures that need the thread raise `StationError`.
        """
        if self._background is not None:
            self._background.close()

    def submit(self, work: Work) -> Future[Any]:
        """Runs work on the thread, or at once if there is none; returns the future of its result.

        Raises:
            StationError: after `close`.
        """
        return _done(work()) if self._background is None else self._background.submit(work)

    def _capture(self, context: Context, state: State) -> None:
        queue: Queue = context.get_abstract_state(self._queue).get_value()
        time, previous = context.get_time(), queue[-1] if queue else None
        if self._timing.captures(queue, time, wanted=self._wanted(context, previous)):
            work = self._begin(context, state, previous)
            if work is not None:
                queue = self._timing.added(queue, time, self.submit(work))
                state.get_mutable_abstract_state(self._queue).set_value(queue)
                state.get_mutable_discrete_state(self._times).SetAtIndex(0, time)
        self._release_due(queue, context, state)

    def _release(self, context: Context, state: State) -> None:
        queue = context.get_abstract_state(self._queue).get_value()
        self._release_due(queue, context, state)

    def _release_due(self, queue: Queue, context: Context, state: State) -> None:
        due = self._timing.due(queue, context.get_time())
        released: Captured = context.get_abstract_state(self._released).get_value()
        if due is None or due.tick <= released.tick:
            return
        with self._stopwatch.measure("waiting"):
            due.result.result()
        state.get_mutable_abstract_state(self._released).set_value(due)
        times = state.get_mutable_discrete_state(self._times)
        times.SetAtIndex(1, context.get_time())
        times.SetAtIndex(2, due.time)


def _done(result: Any) -> Future[Any]:
    future: Future[Any] = Future()
    future.set_result(result)
    return future
