"""Measures the wall-clock time that systems take. Only reports use the results."""

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
        """Records the duration of the `with` block under `name`, even if the block raises."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._durations[name].append(time.perf_counter() - start)

    def durations(self, name: str) -> np.ndarray:
        """Returns the (N,) durations [s] recorded under `name`, in order."""
        return np.array(self._durations.get(name, ()))

    def totals(self) -> dict[str, float]:
        """Returns the total duration [s] for each name."""
        return {name: float(np.sum(durations)) for name, durations in self._durations.items()}
