"""Measures the wall-clock time that systems take. Only reports use the results."""

import time
from collections import defaultdict

import numpy as np


class Stopwatch:
    """Collects the durations of named pieces of work; threads may share an instance."""

    def __init__(self) -> None:
        self._durations: defaultdict[str, list[float]] = defaultdict(list)

    def measure(self, name: str) -> "_Measurement":
        """Records the duration of the `with` block under `name`, even if the block raises."""
        return _Measurement(self._durations[name])

    def durations(self, name: str) -> np.ndarray:
        """Returns the (N,) durations [s] recorded under `name`, in order."""
        return np.array(self._durations.get(name, ()))

    def totals(self) -> dict[str, float]:
        """Returns the total duration [s] for each name."""
        return {name: float(np.sum(durations)) for name, durations in self._durations.items()}


class _Measurement:
    """Appends the duration of a `with` block to a list; several times faster than a generator."""

    def __init__(self, durations: list[float]):
        self._durations = durations

    def __enter__(self) -> None:
        self._start = time.perf_counter()

    def __exit__(self, *exception: object) -> None:
        self._durations.append(time.perf_counter() - self._start)
