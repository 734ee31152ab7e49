"""Measures how long systems take, in wall-clock time, for reports; no simulation reads it."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


class Stopwatch:
    """Collects the durations of named pieces of work; threads may share an instance."""

    def __init__(self) -> None:
        self._durations: defaultdict[str, list[float]] = defaultdict(list)

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Appends the duration of the `with` block to those of `name`, even if the block raises."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._durations[name].append(time.perf_counter() - start)

    def durations(self, name: str) -> np.ndarray:
        """Returns all durations [s] of `name`, in order."""
        return np.array(self._durations.get(name, ()))

    def totals(self) -> dict[str, float]:
        """Returns the total duration [s] for each name."""
        return {name: float(np.sum(durations)) for name, durations in self._durations.items()}
