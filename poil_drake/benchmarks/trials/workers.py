"""Workers, each of which runs one trial at a time: processes of this machine or a Ray cluster.

Run as a program, this module is a worker on this machine. Ray is installed by the extra `cluster`.
"""

import logging
import os
import pickle
import runpy
import select
import signal
import socket
import sys
import threading
import traceback
import types
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from poil_drake.errors import InvalidValueError, MissingDependencyError, PoilError
from poil_drake.runtime.worker_process import WorkerEndedError, WorkerProcess, serve

_CONNECTION_TIMEOUT = 10.0  # [s]

_OBJECT_STORE = 128 * 2**20
"""Shared memory of a cluster that is started here [bytes]. It holds the shared arguments."""


class ProcessWorkers:
    """Up to `jobs` processes, started when they are needed. Each trial runs once.

    A thread waits for each process, so a killed process fails only the future of its trial. A
    `ProcessPoolExecutor` would fail all futures.

    Args:
        function: Runs a trial.
        shared: The first arguments of `function`, the same in all trials.
        jobs: Number of processes that work at the same time.
        trials_per_worker: Number of trials after which a process is replaced; None for never.

    Attributes:
        worker_lost: Exceptions that a future raises if its worker ended before the trial was done.
    """

    worker_lost: tuple[type[Exception], ...] = (WorkerEndedError, OSError)

    def __init__(
        self,
        function: Callable[..., Any],
        shared: tuple[Any, ...],
        jobs: int,
        trials_per_worker: int | None,
    ):
        # A user's script need not be importable: the workers run it, under another name.
        script = getattr(sys.modules["__main__"], "__file__", None)
        script = script if function.__module__ == "__main__" else None
        self._setup = (os.getpid(), script, pickle.dumps((function, shared)))
        self._trials_per_worker = trials_per_worker
        self._executor = ThreadPoolExecutor(jobs)
        self._workers: list[WorkerProcess] = []
        self._idle: list[tuple[WorkerProcess, int]] = []  # With the number of trials run.
        self._closed = False

    def submit(self, arguments: tuple[Any, ...]) -> Future[bytes]:
        """Returns the future outcome of a trial, pickled by `run_trial`."""
        return self._executor.submit(self._run, arguments)

    def _run(self, arguments: tuple[Any, ...]) -> bytes:
        try:
            worker, trials = self._idle.pop()
        except IndexError:
            worker, trials = WorkerProcess(__name__, self._setup), 0
            self._workers.append(worker)
            if self._closed:
                worker.kill()
        outcome = worker.ask(arguments)
        if trials + 1 == self._trials_per_worker:
            worker.end()
        else:
            self._idle.append((worker, trials + 1))
        return outcome

    def close(self) -> None:
        """Ends all processes, busy ones included."""
        self._closed = True
        self._executor.shutdown(wait=False, cancel_futures=True)
        for worker in list(self._workers):
            worker.kill()
        self._executor.shutdown()
        for worker in self._workers:
            worker.end()


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
        """Returns the future outcome of a trial, pickled by `run_trial`."""
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


def _connect(ray: types.ModuleType, address: str, cpus: int) -> None:
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


def run_trial(
    function: Callable[..., Any], shared: tuple[Any, ...], arguments: tuple[Any, ...]
) -> bytes:
    """Returns the pickled outcome of a trial: (result, error, traceback of the error).

    The error is None if the trial succeeds. A `PoilError` is returned as it was raised; any other
    exception becomes a RuntimeError with its text, because not every exception can be pickled.
    """
    try:
        return pickle.dumps((function(*shared, *arguments), None, ""))
    except Exception as error:
        text = traceback.format_exc()
        if not isinstance(error, PoilError):
            error = RuntimeError(f"{type(error).__name__}: {error}")
        return pickle.dumps((None, error, text))


def _make_handler(
    setup: tuple[int, str | None, bytes],
) -> Callable[[tuple[Any, ...]], bytes]:
    parent, script, pickled = setup
    if script is not None:
        main = types.ModuleType("__mp_main__")
        main.__dict__.update(runpy.run_path(script, run_name="__mp_main__"))
        sys.modules["__main__"] = sys.modules["__mp_main__"] = main
    function, shared = pickle.loads(pickled)
    threading.Thread(target=_exit_with, args=(os.pidfd_open(parent),), daemon=True).start()
    return lambda arguments: run_trial(function, shared, arguments)


def _exit_with(process: int) -> None:
    """Waits until the process with a pidfd ends; then ends this process, even in a trial."""
    select.select([process], [], [])
    os._exit(1)


if __name__ == "__main__":
    serve(_make_handler)
    sys.stdout.flush()
    sys.stderr.flush()
    # Skips Python's shutdown: OMPL's bindings would report every type that a failed trial uses.
    os._exit(0)
