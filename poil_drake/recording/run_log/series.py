"""A signal sampled over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

ROUNDING = 1e-9
"""Tolerance for the rounding of times to nanoseconds [s]."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples in chronological order.

    Attributes:
        times: (T,) times of the samples [s].
        values: (T, N) samples, one per row.
    """

    times: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, samples: Sequence[tuple[float, Sequence[float] | np.ndarray]], size: int) -> Self:
        """Makes a series from unordered (time [s], sample) pairs with `size` values per sample."""
        ordered = sorted(samples, key=lambda sample: sample[0])
        times = np.array([time for time, _ in ordered], dtype=float)
        return cls(times, np.array([value for _, value in ordered], float).reshape(-1, size))

    def __len__(self) -> int:
        return len(self.times)

    @property
    def period(self) -> float:
        """Median time between the samples [s]; NaN if there are fewer than two."""
        return float(np.median(np.diff(self.times))) if len(self) > 1 else float("nan")

    def index(self, time: float) -> int:
        """Returns the index of the newest sample at or before a time [s]; -1 if there is none."""
        return int(np.searchsorted(self.times, time + ROUNDING, side="right")) - 1

    def at(self, time: float) -> np.ndarray:
        """Returns the (N,) newest sample at or before a time [s]; NaN if there is none."""
        index = self.index(time)
        return np.full(self.values.shape[1:], np.nan) if index < 0 else self.values[index]
