"""Ray workers that run trials; Ray is installed by the extra `cluster`."""

import logging
import os
import signal
import socket
import threading
from collections.abc import Callable
from concurrent.futures import Future
from types import ModuleType
from typing import Any

from poil_drake.benchmarks.trials.processes import run_trial
from poil_drake.errors import InvalidValueError, MissingDependencyError

_CONNECTION_TIMEOUT = 10.0  # [s]

_OBJECT_STORE = 128 * 2**20
"""Shared memory of a cluster that is started here [bytes]. It holds the shared arguments."""


class ClusterWorkers:
    """The workers of a Ray cluster, which run each trial once.

    Args:
        function: Runs a trial.
        shared: The first arguments of `function`, the same in all trials.
        address: Address of the cluster, as for `ray.init`.
        cpus: Number of CPUs of a cluster that is started here.
        trials_per_worker: Number of trials after which a process is replaced; None for never.

    Attributes:
        worker_lost: Exceptions that a future raises if its worker ended before the trial was done.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        shared: tuple[Any, ...],
        address: str,
        cpus: int,
        trials_per_worker: int | None,
    ):
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # Disables Ray's telemetry.
        try:
            import ray
        except ImportError as error:
            raise MissingDependencyError(
                "Ray is not installed.",
                remedy="Run: pip install 'poil_drake[cluster]', or leave out the Ray address.",
            ) from error
        self._ray = ray
        self.worker_lost: tuple[type[Exception], ...] = (
            ray.exceptions.WorkerCrashedError,
            ray.exceptions.OutOfMemoryError,
            ray.exceptions.NodeDiedError,
            ray.exceptions.LocalRayletDiedError,
            ray.exceptions.ObjectLostError,
        )
        # The pool counts the attempts, so Ray must not retry.
        self._task = ray.remote(max_retries=0, max_calls=trials_per_worker or 0)(run_trial)
        self._running: set[Any] = set()
        self._started = not ray.is_initialized()
        if self._started:
            _connect(ray, address, cpus)
        self._first = (ray.put(function), ray.put(shared))

    def submit(self, arguments: tuple[Any, ...]) -> Future[bytes]:
        """Returns the future outcome of a trial, pickled by `processes.run_trial`."""
        reference = self._task.remote(*self._first, arguments)
        self._running.add(reference)
        future = reference.future()
        future.add_done_callback(lambda _: self._running.discard(reference))
        return future

    def close(self) -> None:
        """Ends the workers of this run, and the cluster if it was started here."""
        for reference in list(self._running):
            self._ray.cancel(reference, force=True)
        if self._started:
            self._ray.shutdown()


def _connect(ray: ModuleType, address: str, cpus: int) -> None:
    options: dict[str, Any] = {}
    if address == "local":
        options = {
            "num_cpus": cpus,
            "include_dashboard": False,
            "object_store_memory": _OBJECT_STORE,
        }
    handler = signal.getsignal(signal.SIGTERM)
    try:
        _require_listener(address)
        ray.init(address=address, logging_level=logging.ERROR, log_to_driver=False, **options)
    except (OSError, ValueError, RuntimeError) as error:
        raise InvalidValueError(
            f"The Ray cluster at '{address}' cannot be used: {str(error).rstrip('.')}.",
            remedy="Start a cluster with `ray start --head`, with the Python and Ray versions of "
            "this machine, or use the address 'local'.",
        ) from error
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)  # Ray replaces it, on the main thread only.


def _require_listener(address: str) -> None:
    """Raises an OSError at once if no server listens at the address; Ray would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host, int(port)), timeout=_CONNECTION_TIMEOUT).close()
