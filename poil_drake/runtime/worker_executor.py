"""An executor whose functions run in a worker process; this module is also its program."""

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from importlib import import_module
from typing import Any

from poil_drake.runtime.worker_process import WorkerProcess, serve


class WorkerExecutor(Executor):
    """Runs functions in one worker process, one after another.

    Unlike a `ProcessPoolExecutor`, it neither forks nor runs the user's script again. Functions,
    arguments and results are pickled, functions by their names. An error that is no `PoilError`
    arrives as a RuntimeError that holds the traceback.
    """

    def __init__(self, *modules: str) -> None:
        """Starts the process, without waiting until it is ready.

        Args:
            modules: Modules that take long to import; the process imports them at once.
        """
        self._worker = WorkerProcess(__name__, modules)
        self._thread = ThreadPoolExecutor(max_workers=1)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        """Returns the future of `fn(*args, **kwargs)`."""
        return self._thread.submit(self._worker.ask, (fn, args, kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the process after the submitted calls; see `Executor.shutdown`."""
        self._thread.submit(self._end)
        self._thread.shutdown(wait, cancel_futures=cancel_futures)

    def _end(self) -> None:
        self._worker.kill()  # It is idle, and would take 0.2 s to end by itself.
        self._worker.end()


def _make_handler(modules: tuple[str, ...]) -> Callable[[tuple], Any]:
    for module in modules:
        import_module(module)
    return lambda request: request[0](*request[1], **request[2])


if __name__ == "__main__":
    serve(_make_handler)
