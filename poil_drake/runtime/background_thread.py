"""One thread for the work of a system beside the simulation."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar

from poil_drake.errors import StationError

_P = ParamSpec("_P")
_T = TypeVar("_T")


class Background:
    """Runs work on one thread, which is started by the constructor, one piece after the other."""

    def __init__(self, name: str):
        """Starts the thread.

        Args:
            name: Name of the thread, also in the error of a use after `close`.
        """
        self._name = name
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)
        # Without work, an executor starts no thread.
        self._executor.submit(int).result()
        self._futures: list[Future[Any]] = []

    def submit(self, work: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Returns the future result of the work.

        Raises:
            StationError: after `close`.
        """
        try:
            future = self._executor.submit(work, *args, **kwargs)
        except RuntimeError as error:
            raise StationError(
                f"The {self._name} has been closed.",
                remedy="Close the loop after its last AdvanceTo, or build a new one.",
            ) from error
        self._futures = [*self._unfinished(), future]
        return future

    def close(self) -> None:
        """Finishes the current or next piece of work, and cancels the others."""
        for future in self._unfinished()[1:]:
            future.cancel()
        self._executor.shutdown(wait=True)

    def _unfinished(self) -> list[Future[Any]]:
        return [future for future in self._futures if not future.done()]
