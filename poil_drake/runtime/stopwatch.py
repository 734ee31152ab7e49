"""Wall-clock durations of work that systems do, for reports; nothing in a simulation reads them."""

import time
from collections import defaultdict
from contextlib import AbstractContextManager

import numpy as np


class Stopwatch:
    """Collects how long named pieces of work took; may be shared between threads."""

    def __init__(self) -> None:
        self._durations: defaultdict[str, list[float]] = defaultdict(list)

    def measure(self, name: str) -> AbstractContextManager[None]:
        """Adds the duration of the `with` block to those of `name`."""
        return _Measurement(self._durations[name])

    def durations(self, name: str) -> np.ndarray:
        """Returns all durations [s] of `name`, in order."""
        return np.array(self._durations.get(name, ()))

    def totals(self) -> dict[str, float]:
        """Returns the sum of the durations [s] of every name."""
        return {name: float(np.sum(durations)) for name, durations in self._durations.items()}


class _Measurement(AbstractContextManager[None]):
    """A class of its own, as it runs several times at each control tick: generators are slower."""

    def __init__(self, durations: list[float]):
        self._durations = durations

    def __enter__(self) -> None:
        self._start = time.perf_counter()

    def __exit__(self, *exception: object) -> None:
        self._durations.append(time.perf_counter() - self._start)
