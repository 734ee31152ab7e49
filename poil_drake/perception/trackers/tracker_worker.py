"""The worker process of `process_tracker`: serves one tracker."""

from itertools import count
from typing import Any

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.runtime.worker_process import serve


class TrackerService:
    """Calls a tracker, and keeps the tracker's states by their keys."""

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


if __name__ == "__main__":
    serve(TrackerService)
