"""A worker thread with a bounded queue, for work that must not hold up a control loop."""

import queue
import threading
from collections.abc import Callable

from poil_drake.runtime.interpreter_turns import TURNS

Job = Callable[[], None]


class BackgroundWorker:
    """Runs jobs one after the other, in the order given, in a thread of its own.

    An exception in a job stops the work: it is raised by the next `submit` or by `close`, and
    the jobs after it are dropped.

    Args:
        name: The thread's name.
        capacity: How many jobs may wait. A job given when all places are taken either waits for
            one (so that nothing is lost), or is dropped and counted, as `submit` is told.
    """

    def __init__(self, *, name: str, capacity: int):
        self._jobs: queue.Queue[Job | None] = queue.Queue(capacity)
        self._error: Exception | None = None
        self._closed = False
        self._dropped = 0
        # A daemon, so that a program that forgets `close` can still end.
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """How many jobs were dropped because the queue was full."""
        return self._dropped

    def submit(self, job: Job, *, may_drop: bool = False) -> None:
        """Hands over a job.

        Raises:
            ValueError: after `close`.
            Exception: that an earlier job raised.
        """
        if self._closed:
            raise ValueError("The worker is closed.")
        self._raise_error()
        try:
            self._jobs.put(job, block=not may_drop)
        except queue.Full:
            self._dropped += 1

    def close(self) -> None:
        """Waits until all jobs are done and ends the thread. A second call does nothing.

        Raises:
            Exception: that a job raised, once.
        """
        if self._closed:
            return
        self._closed = True
        self._jobs.put(None)
        self._thread.join()
        self._raise_error()

    def _raise_error(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _work(self) -> None:
        failed = False
        while (job := self._jobs.get()) is not None:
            if failed:
                continue
            TURNS.wait()
            try:
                job()
            # Of whatever kind: it is handed to the caller, who is in another thread.
            except Exception as error:
                failed = True
                self._error = error
