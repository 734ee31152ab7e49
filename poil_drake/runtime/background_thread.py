"""One thread for the work that a system does beside the simulation."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar

from poil_drake.errors import StationError

_P = ParamSpec("_P")
_T = TypeVar("_T")


class Background:
    """Does one thing after the other on a thread, which is there from the beginning."""

    def __init__(self, name: str):
        """Starts the thread.

        Args:
            name: What the thread is called, and the error of a use after `close`.
        """
        self._name = name
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)
        # It would start its thread with the first work only.
        self._executor.submit(int).result()
        self._futures: list[Future[Any]] = []

    def submit(self, work: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Returns what will be the result of the work.

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
        """Finishes the work in hand, also if the thread has yet to begin, and forgets the rest."""
        for future in self._unfinished()[1:]:
            future.cancel()
        self._executor.shutdown(wait=True)

    def _unfinished(self) -> list[Future[Any]]:
        return [future for future in self._futures if not future.done()]
