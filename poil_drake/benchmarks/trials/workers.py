"""Processes of this machine that run trials, each one at a time.

A worker has a pipe of its own, so that it is known which trial it was running when it is killed;
`concurrent.futures` only knows that one of all workers is gone, and gives up on all trials.
"""

import functools
import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple

_GRACE = 5.0
"""How long a worker gets to end by itself [s]."""

_LOOK = 1.0
"""How often it is looked whether a worker has ended without closing its pipe [s]."""

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

_STOPPING = {signal.SIGINT, signal.SIGTERM}


class WorkerKilled(NamedTuple):
    """In place of a result: the worker ended before it had one.

    Attributes:
        cause: How, as the end of a sentence.
    """

    cause: str


@dataclass(eq=False)
class _Worker:
    process: SpawnProcess
    connection: Connection
    index: int = -1
    trials: int = 0


class ProcessWorkers:
    """Up to `count` processes, started as they are needed (see `trial_pool.TrialWorkers`)."""

    def __init__(
        self,
        function: Callable[..., Any],
        shared: tuple[Any, ...],
        *,
        count: int,
        trials_per_worker: int | None,
    ):
        """Prepares; starts nothing.

        Args:
            function: What runs a trial.
            shared: Its first arguments.
            count: How many work side by side.
            trials_per_worker: How many trials a process runs; None for any number.
        """
        self._setup = pickle.dumps((function, shared))
        self._count = count
        self._trials_per_worker = trials_per_worker
        self._busy: dict[Connection, _Worker] = {}
        self._idle: list[_Worker] = []
        self._ending: list[_Worker] = []

    def has_room(self) -> bool:
        """Returns whether one more trial may be started."""
        return len(self._busy) < self._count

    def start(self, index: int, arguments: tuple[Any, ...]) -> None:
        """Starts a trial, on a process that is there or a new one."""
        request = pickle.dumps(arguments)
        worker = self._idle.pop() if self._idle else None
        if worker is not None and not worker.process.is_alive():
            self._retire(worker)
            worker = None
        messages = [request] if worker is not None else [self._setup, request]
        worker = worker or self._spawn()
        self._busy[worker.connection] = worker
        worker.index = index
        worker.trials += 1
        try:
            for message in messages:
                worker.connection.send_bytes(message)
        except OSError:
            pass  # It has been killed, which `next_end` finds out.

    def _spawn(self) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        process = multiprocessing.get_context("spawn").Process(
            target=_serve, args=(theirs,), name="trial worker", daemon=True
        )
        # Ctrl-C goes to the whole process group, yet is for this process alone, which then ends its
        # workers: they inherit that it is blocked. SIGTERM waits until they can be ended.
        resource_tracker.ensure_running()  # As it starts, it lets them through again.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPPING)
        try:
            with _environment_of_workers():
                process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        return _Worker(process, ours)

    def next_end(self) -> tuple[int, Any]:
        """Waits until a trial ends; returns which, and its result or a `WorkerKilled`."""
        while True:
            ready = wait(list(self._busy), timeout=_LOOK)
            for connection, worker in self._busy.items():
                # A child of a worker may have inherited its end of the pipe, and keep it open.
                if connection in ready or not worker.process.is_alive():
                    del self._busy[connection]
                    return self._receive(worker)

    def _receive(self, worker: _Worker) -> tuple[int, Any]:
        try:
            answer = worker.connection.recv_bytes() if worker.connection.poll() else b""
        except (EOFError, OSError):
            answer = b""
        if not answer:
            self._retire(worker)
            worker.process.join(_GRACE)
            return worker.index, WorkerKilled(_ended(worker.process.exitcode))
        if worker.trials == self._trials_per_worker:
            self._retire(worker)
        else:
            self._idle.append(worker)
        done, value, text = pickle.loads(answer)
        if not done:
            value.add_note(f"It was raised by trial {worker.index}:\n{text}")
            raise value
        return worker.index, value

    def _retire(self, worker: _Worker) -> None:
        """Lets a worker know that it is not needed any more; does not wait for it."""
        worker.connection.close()
        self._ending = [w for w in self._ending if w.process.is_alive()] + [worker]

    def close(self) -> None:
        """Ends all processes, the busy ones at once."""
        for worker in self._busy.values():
            worker.process.terminate()
        for worker in (*self._busy.values(), *self._idle):
            worker.connection.close()
        workers = [*self._busy.values(), *self._idle, *self._ending]
        self._busy.clear()
        self._idle.clear()
        self._ending.clear()
        deadline = time.monotonic() + _GRACE
        for worker in workers:
            worker.process.join(max(deadline - time.monotonic(), 0.0))
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()


@contextmanager
def _environment_of_workers() -> Iterator[None]:
    """Lets processes that are started within compute on one core, as Ray's workers do.

    Sums have other rounding errors on more cores, so results would depend on where a trial runs;
    and the workers would wait for each other.
    """
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _ended(status: int | None) -> str:
    if status is None:
        return "closed its pipe"
    if status >= 0:
        return f"ended with status {status}"
    try:
        return f"was killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"was killed by signal {-status}"


def _serve(connection: Connection) -> None:
    """Runs trials until the pipe is closed."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    # Whoever kills the parent so that it cannot end its workers has ended them, too.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    pickled = connection.recv_bytes()

    @functools.cache
    def setup() -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return pickle.loads(pickled)

    while True:
        try:
            request = connection.recv_bytes()
        except EOFError:
            return
        connection.send_bytes(_answer(setup, request))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _answer(
    setup: Callable[[], tuple[Callable[..., Any], tuple[Any, ...]]], request: bytes
) -> bytes:
    """Returns the pickle of (True, the result, "") or (False, the exception, where it arose)."""
    try:
        function, shared = setup()
        return pickle.dumps((True, function(*shared, *pickle.loads(request)), ""))
    except Exception as error:
        text = traceback.format_exc()
        try:
            failure = pickle.dumps((False, error, text))
            pickle.loads(failure)  # Many an exception can be pickled, yet not read back.
        except Exception:
            failure = pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}"), text))
        return failure
