"""Wall-clock durations of the work of systems, for reports; nothing in a simulation reads them."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


class Stopwatch:
    """Collects how long named pieces of work took; threads may share it."""

    def __init__(self) -> None:
        self._durations: defaultdict[str, list[float]] = defaultdict(list)

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Adds the duration of the `with` block to those of `name`, even if the block raises."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._durations[name].append(time.perf_counter() - start)

    def durations(self, name: str) -> np.ndarray:
        """Returns all durations [s] of `name`, in order."""
        return np.array(self._durations.get(name, ()))

    def totals(self) -> dict[str, float]:
        """Returns the sum of the durations [s] of every name."""
        return {name: float(np.sum(durations)) for name, durations in self._durations.items()}
