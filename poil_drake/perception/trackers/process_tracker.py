"""A tracker in a process of its own, so that it and the control loop do not share one interpreter.

Python runs one thread at a time. A tracker of many small array operations on a second thread slows
the first one down as much as it gains; in another process it uses the second core.
"""

import mmap
import os
import pickle
import subprocess
import sys
import weakref
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.protocol import PointTracker, TrackerOutput

_GRACE = 2.0  # [s] that a worker gets to end by itself


class RemoteState(SharedOnCopy):
    """Stands for a state that the worker holds, for as long as somebody holds this.

    Attributes:
        worker: Number of the worker process, counted by its tracker.
        key: The state's number there.
    """

    def __init__(self, worker: int, key: int):
        self.worker, self.key = worker, key


class ProcessTracker:
    """Runs another tracker in a process of its own; a `PointTracker` itself.

    The worker starts at once, so that it is ready when it is needed. States stay with it; what is
    handed out stands for them. Images go through shared memory. Calls block, but leave Python to
    other threads. Where the worker has died, `step` raises a TrackingError, which means that the
    object is lost, and `start` begins with a new worker.

    It is not meant to be called by two threads at once. The worker is a program of its own, not a
    fork and not a `multiprocessing.Process`, which would run the user's script once more.
    """

    def __init__(self, tracker: PointTracker):
        """Starts the worker.

        Args:
            tracker: What tracks; it is pickled, and its module must be importable.
        """
        self._tracker = pickle.dumps(tracker)
        self._dropped: list[int] = []
        self._workers = 0
        self._worker: _Worker | None = None
        self._launch()

    @property
    def pid(self) -> int | None:
        """The worker's process number; None after `close`."""
        return None if self._worker is None else self._worker.process.pid

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        """See `PointTracker.start`."""
        if self._worker is None or self._worker.process.poll() is not None:
            self._launch()
        return self._call("start", None, frame, query_points, object_masks)

    def step(
        self, state: RemoteState, frame: MultiViewFrame, motion_prior: np.ndarray | None = None
    ) -> TrackerOutput:
        """See `PointTracker.step`."""
        if state.worker != self._workers:
            raise _died(None)
        return self._call("step", state.key, frame, motion_prior)

    def close(self) -> None:
        """Ends the worker. States are lost; a `start` begins with a new worker."""
        if self._worker is not None:
            self._worker.end()
            self._worker = None

    def _launch(self) -> None:
        self.close()
        self._workers += 1
        self._dropped = []
        self._worker = _Worker(self._tracker)

    def _call(self, method: str, key: int | None, *arguments: Any) -> TrackerOutput:
        worker = self._worker
        if worker is None:
            raise _died(None)
        dropped = self._dropped[:]
        del self._dropped[: len(dropped)]
        try:
            answer = worker.ask((method, key, arguments, dropped))
        except (EOFError, OSError) as error:
            self.close()
            raise _died(worker) from error
        if isinstance(answer, TrackingError):
            raise answer
        if isinstance(answer, str):
            raise RuntimeError(f"The tracker failed in its process.\n{answer}")
        new_key, points, lost = answer
        state = RemoteState(self._workers, new_key)
        weakref.finalize(state, self._dropped.append, new_key)
        return TrackerOutput(state, points, lost)


class _Worker:
    """The process, and the ways to it: a connection, and memory for images."""

    def __init__(self, tracker: bytes):
        self.connection, theirs = Pipe()
        # Memory without a name: nothing is left behind, however the processes end.
        self._file = os.memfd_create("poil_tracker_frames")
        self._memory: mmap.mmap | None = None
        with theirs:
            files = (theirs.fileno(), self._file)
            self.process = subprocess.Popen(
                [sys.executable, "-m", f"{__package__}.worker", *map(str, files)],
                pass_fds=files,
                env=_environment(),
                stdin=subprocess.DEVNULL,
            )
        # The worker ends by itself when this end is closed, so also when this process ends.
        self._close = weakref.finalize(self, _close, self.connection, self._file)
        self.connection.send_bytes(tracker)

    def ask(self, request: object) -> Any:
        """Sends a request, its arrays through the shared memory, and returns the answer."""
        buffers: list[pickle.PickleBuffer] = []
        message = pickle.dumps(request, protocol=5, buffer_callback=buffers.append)
        views = [buffer.raw() for buffer in buffers]
        sizes = [view.nbytes for view in views]
        memory = self._memory_of(sum(sizes))
        place = 0
        for view, size in zip(views, sizes, strict=True):
            memory[place : place + size] = view
            place += size
        self.connection.send(sizes)
        self.connection.send_bytes(message)
        return self.connection.recv()

    def end(self) -> None:
        """Closes the connection, and waits for the process to end."""
        self._close()
        try:
            self.process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _memory_of(self, size: int) -> mmap.mmap:
        """Returns the memory, of at least this size [bytes]."""
        if self._memory is None or len(self._memory) < size:
            size = max(size, mmap.PAGESIZE)
            os.ftruncate(self._file, size)
            self._memory = mmap.mmap(self._file, size)
        return self._memory


def _environment() -> dict[str, str]:
    """Returns the worker's: it finds what this process finds, and computes on one core.

    More threads than that would only wait for each other.
    """
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def _close(connection: Connection, file: int) -> None:
    connection.close()
    os.close(file)


def _died(worker: _Worker | None) -> TrackingError:
    status = None if worker is None else worker.process.poll()
    return TrackingError(
        "The tracker's process has ended"
        + (f" with status {status}." if status is not None else "."),
        remedy="Start to track anew; see what it wrote, or whether memory ran out.",
    )
