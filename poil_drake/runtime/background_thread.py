"""Threads that work in parallel with a simulation or a control loop."""

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar

from poil_drake.errors import StationError
from poil_drake.runtime.interpreter_turns import TURNS

_P = ParamSpec("_P")
_T = TypeVar("_T")

Job = Callable[[], None]


class Background:
    """Runs pieces of work one after the other on one thread, which the constructor starts.

    Args:
        name: Name of the thread; the error of `submit` after `close` quotes it.
    """

    def __init__(self, name: str):
        self._name = name
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)
        # An executor starts its thread with the first piece of work.
        self._executor.submit(int).result()
        self._futures: list[Future[Any]] = []

    def submit(self, work: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Queues the call `work(*args, **kwargs)` and returns the future of its result.

        Raises:
            StationError: if this object has been closed.
        """
        try:
            future = self._executor.submit(work, *args, **kwargs)
        except RuntimeError as error:
            raise StationError(
                f"The {self._name} has been closed.",
                remedy="Close the loop only after its last AdvanceTo, or build a new loop.",
            ) from error
        self._futures = [*self._unfinished(), future]
        return future

    def close(self) -> None:
        """Finishes the oldest unfinished piece of work, cancels the rest, and ends the thread."""
        for future in self._unfinished()[1:]:
            future.cancel()
        self._executor.shutdown(wait=True)

    def _unfinished(self) -> list[Future[Any]]:
        return [future for future in self._futures if not future.done()]


class BackgroundWorker:
    """Runs jobs in a separate thread, one after the other, for work that must not hold up a loop.

    The queue of jobs is bounded. Jobs are handed over in batches, because each handover may cost a
    switch of threads.

    After an exception in a job, no further job runs; the next `submit` or `close` raises the
    exception.

    Args:
        name: The thread's name.
        capacity: How many batches may wait. If the queue is full, `submit` either waits, so that no
            job is lost, or drops the batch and counts its jobs.
        batch: Number of jobs in a batch.

    Attributes:
        dropped: Number of jobs that were dropped because the queue was full.
    """

    def __init__(self, *, name: str, capacity: int, batch: int = 1):
        self._queue: queue.Queue[list[Job]] = queue.Queue(capacity)
        self._batch, self._batch_size = list[Job](), batch
        self._error: Exception | None = None
        self._closed = False
        self.dropped = 0
        # A daemon, so that a program that does not call `close` can still end.
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def submit(self, job: Job, *, may_drop: bool = False) -> None:
        """Adds a job to the batch, which is queued once it is full.

        Args:
            job: The job.
            may_drop: What happens if this job fills its batch, but the queue is full: True drops
                the batch, False waits.

        Raises:
            ValueError: if the worker has been closed.
            Exception: the exception that an earlier job raised.
        """
        if self._closed:
            raise ValueError(f"The worker '{self._thread.name}' is closed and takes no more jobs.")
        self._raise_error()
        self._batch.append(job)
        if len(self._batch) < self._batch_size:
            return
        batch, self._batch = self._batch, []
        try:
            self._queue.put(batch, block=not may_drop)
        except queue.Full:
            self.dropped += len(batch)

    def close(self) -> None:
        """Waits until all jobs are done and ends the thread. A second call does nothing.

        Raises:
            Exception: the exception that a job raised, unless a `submit` has raised it already.
        """
        if self._closed:
            return
        self._closed = True
        for batch in (self._batch, []):
            self._queue.put(batch)
        self._thread.join()
        self._raise_error()

    def _raise_error(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _work(self) -> None:
        failed = False
        while batch := self._queue.get():
            for job in batch:
                if failed:
                    break
                TURNS.wait()
                try:
                    job()
                # Any exception, because the caller's thread raises it.
                except Exception as error:
                    failed = True
                    self._error = error
