"""Ray workers that run trials (extra `cluster`)."""

import logging
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

from poil_drake.benchmarks.trials.workers import WorkerKilled
from poil_drake.errors import InvalidValueError, MissingDependencyError

_ANSWER = 10.0
"""How long a cluster gets to answer [s]."""

_OBJECT_STORE = 128 * 2**20
"""Shared memory of a cluster that is started here [bytes]; what is shared must fit."""


class ClusterWorkers:
    """The workers of a Ray cluster (see `trial_pool.TrialWorkers`)."""

    def __init__(
        self,
        function: Callable[..., Any],
        shared: tuple[Any, ...],
        *,
        address: str,
        cpus: int,
        trials_per_worker: int | None,
    ):
        """Connects to the cluster, or starts one.

        Args:
            function: What runs a trial.
            shared: Its first arguments.
            address: As `ray.init` takes it.
            cpus: Of a cluster that is started here.
            trials_per_worker: How many trials a process runs; None for any number.
        """
        # Ray would tell its makers who uses it.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        try:
            import ray
        except ImportError as error:
            raise MissingDependencyError(
                "Ray is not installed.",
                remedy="Run: pip install 'poil_drake[cluster]', or leave out the address.",
            ) from error
        self._ray = ray
        # Killed workers are seen to by the caller, who knows what has been tried how often.
        self._task = ray.remote(max_retries=0, max_calls=trials_per_worker or 0)(_call)
        self._running: dict[int, Any] = {}
        self._ended: SimpleQueue[int] = SimpleQueue()
        self._started = not ray.is_initialized()
        if self._started:
            _connect(address, cpus)
        try:
            self._function = ray.put(function)
            self._shared = [ray.put(value) for value in shared]
        except BaseException:
            self.close()
            raise

    def has_room(self) -> bool:
        """Returns whether one more trial may be started: Ray's queue has no end."""
        return True

    def start(self, index: int, arguments: tuple[Any, ...]) -> None:
        """Lets Ray start a trial when a CPU is free."""
        reference = self._task.remote(self._function, arguments, *self._shared)
        self._running[index] = reference
        reference.future().add_done_callback(lambda _: self._ended.put(index))

    def next_end(self) -> tuple[int, Any]:
        """Waits until a trial ends; returns which, and its result or a `WorkerKilled`."""
        errors = self._ray.exceptions
        index = self._ended.get()  # Ray's own wait does not let exceptions of signals through.
        reference = self._running.pop(index)
        try:
            return index, self._ray.get(reference)
        except errors.RayTaskError as error:
            cause = error.cause if isinstance(error.cause, Exception) else error
            cause.add_note(f"It was raised by trial {index}:\n{error}")
            raise cause from None
        except (
            errors.WorkerCrashedError,
            errors.OutOfMemoryError,
            errors.NodeDiedError,
            errors.LocalRayletDiedError,
            errors.ObjectLostError,
        ) as error:
            return index, WorkerKilled(f"ended with {type(error).__name__}")

    def close(self) -> None:
        """Ends the workers of this run; the cluster too, if it was started here."""
        for reference in self._running.values():
            self._ray.cancel(reference, force=True)
        self._running.clear()
        if self._started:
            self._ray.shutdown()


def _call(function: Callable[..., Any], arguments: tuple[Any, ...], *shared: Any) -> Any:
    return function(*shared, *arguments)


def _connect(address: str, cpus: int) -> None:
    import ray

    own = {}
    if address == "local":
        own = {
            "num_cpus": cpus,
            "include_dashboard": False,
            "object_store_memory": _OBJECT_STORE,
        }
    try:
        _knock(address)
        with _signals_kept():
            ray.init(address=address, logging_level=logging.ERROR, log_to_driver=False, **own)
    except (OSError, ValueError, RuntimeError) as error:
        raise InvalidValueError(
            f"The Ray cluster at '{address}' cannot be used: {error}",
            remedy="Start one with `ray start --head`, of the same versions of Python and Ray, or "
            "pass 'local'.",
        ) from error


def _knock(address: str) -> None:
    """Raises an OSError at once where nobody listens; Ray would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host, int(port)), timeout=_ANSWER).close()


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Undoes that Ray takes over SIGTERM."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
