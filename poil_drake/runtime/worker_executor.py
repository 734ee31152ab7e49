"""An executor whose functions run in a worker process; this module is also its program."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from importlib import import_module
from typing import Any, TypeVar

from poil_drake.errors import PoilError
from poil_drake.runtime.worker_process import WorkerEndedError, WorkerProcess, serve

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def run_in_halves(
    function: Callable[[Sequence[_Item]], Sequence[_Result]],
    items: Sequence[_Item],
    executor: Executor | None,
) -> list[_Result]:
    """Returns the results of `function` for both halves of `items`, in their order.

    The second half runs in the executor while the caller runs the first. Without an executor, the
    caller runs both, one after the other. If both raise an error, the first half's is raised.
    """
    middle = (len(items) + 1) // 2
    first, second = items[:middle], items[middle:]
    if not second:
        return list(function(first))
    if executor is None:
        return [*function(first), *function(second)]
    later = executor.submit(function, second)
    return [*function(first), *later.result()]


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
        return self._thread.submit(self._ask, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `Executor.shutdown`. Without `wait`, the process ends when this object is deleted."""
        self._thread.shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            self._worker.kill()  # It is idle, and would take 0.2 s to end by itself.
            self._worker.end()

    def _ask(self, *request: Any) -> Any:
        try:
            return self._worker.ask(request)
        except WorkerEndedError as error:
            raise PoilError(
                f"A worker process {error}.",
                remedy="Check its output, and whether memory ran out.",
            ) from error


def _make_handler(modules: tuple[str, ...]) -> Callable[[tuple], Any]:
    for module in modules:
        import_module(module)
    return lambda request: request[0](*request[1], **request[2])


if __name__ == "__main__":
    serve(_make_handler)
