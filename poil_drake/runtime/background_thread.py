"""A thread that does a system's work in parallel with the simulation."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar

from poil_drake.errors import StationError

_P = ParamSpec("_P")
_T = TypeVar("_T")


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
