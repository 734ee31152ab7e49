"""Runs a tracker in another process, so that it does not share the control loop's interpreter.

Python runs one thread at a time. On a second thread, a tracker with many small array operations
would slow down the first thread. In another process it uses a second core.
"""

import weakref
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import Tracker, TrackerOutput
from poil_drake.runtime.worker_process import WorkerEndedError, WorkerProcess, serve


@dataclass(frozen=True, eq=False)
class RemoteState(SharedOnCopy):
    """Refers to a tracker's state in the worker, which keeps the state while this object lives.

    Attributes:
        worker: Number of the worker process among all that the `ProcessTracker` has started.
        key: Number of the state in that process.
    """

    worker: int
    key: int


class ProcessTracker:
    """Runs another tracker in a worker process; a `Tracker` itself.

    The worker starts at construction, so that it is ready when needed. It keeps the tracker's
    states; the returned states only refer to them. Images pass through shared memory. Calls block,
    but release the interpreter. If the worker has died, `step` raises a TrackingError, which means
    that the object is lost; `start` then starts a new worker. All methods except `abort` must be
    called by one thread at a time.
    """

    def __init__(self, tracker: Tracker):
        """Starts the worker.

        Args:
            tracker: The tracker to run. It is pickled, and its module must be importable.
        """
        self._tracker = tracker
        self._workers = 0
        self._worker: WorkerProcess | None = None
        self._launch()

    @property
    def pid(self) -> int | None:
        """The worker's process ID; None after `close`."""
        return None if self._worker is None else self._worker.pid

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        """Starts tracking; see `Tracker.start`."""
        if self._worker is None or not self._worker.alive:
            self._launch()
        return self._call("start", None, frame, query_points, object_masks)

    def step(
        self, state: RemoteState, frame: MultiViewFrame, motion_prior: np.ndarray | None = None
    ) -> TrackerOutput:
        """Tracks the points to the next frame; see `Tracker.step`."""
        if state.worker != self._workers:
            raise _lost("has ended")
        return self._call("step", state.key, frame, motion_prior)

    def abort(self) -> None:
        """Kills the worker; its current result is lost. Any thread may call this."""
        if (worker := self._worker) is not None:
            worker.kill()

    def close(self) -> None:
        """Ends the worker; its states are lost. A later `start` starts a new worker."""
        if self._worker is not None:
            self._worker.end()
            self._worker = None

    def _launch(self) -> None:
        self.close()
        self._workers += 1
        self._dropped: list[int] = []
        self._worker = WorkerProcess(f"{__package__}.process_tracker", self._tracker)

    def _call(self, method: str, key: int | None, *arguments: Any) -> TrackerOutput:
        if self._worker is None:
            raise _lost("has ended")
        dropped = self._dropped[:]
        del self._dropped[: len(dropped)]
        try:
            new_key, points, lost = self._worker.ask((method, key, arguments, dropped))
        except WorkerEndedError as error:
            self.close()
            raise _lost(str(error)) from error
        state = RemoteState(self._workers, new_key)
        weakref.finalize(state, self._dropped.append, new_key)
        return TrackerOutput(state, points, lost)


class _Service:
    """Calls a tracker in the worker, and keeps the tracker's states by their keys."""

    def __init__(self, tracker: Tracker):
        self._tracker = tracker
        self._states: dict[int, Any] = {}
        self._keys = count()

    def __call__(
        self, request: tuple[str, int | None, tuple, list[int]]
    ) -> tuple[int, TrackedPoints, bool]:
        """Answers a request (method, state's key or None, other arguments, keys to forget).

        Returns:
            The key of the new state, the points, and whether the object is lost.
        """
        method, key, arguments, dropped = request
        for old in dropped:
            self._states.pop(old, None)
        before = () if key is None else (self._states[key],)
        output = getattr(self._tracker, method)(*before, *arguments)
        new = next(self._keys)
        self._states[new] = output.state
        return new, output.points, output.lost


def _lost(reason: str) -> TrackingError:
    return TrackingError(
        f"The tracker's process {reason}.",
        remedy="Start tracking again. Check the output of the process, and whether memory ran out.",
    )


if __name__ == "__main__":
    serve(_Service)
