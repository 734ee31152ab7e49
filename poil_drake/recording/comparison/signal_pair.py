"""Differences of two runs' samples of one signal."""

from typing import NamedTuple, Self

import numpy as np

from poil_drake.recording.run_log.series import Series

_ROUNDING = 1e-9
"""Rounding of times that were written as nanoseconds [s]."""


class SignalPair(NamedTuple):
    """A signal in two runs, at the times that both have.

    Attributes:
        times: (T,) [s], in order.
        a: (T, n) its values in one run.
        b: (T, n) its values in the other.
    """

    times: np.ndarray
    a: np.ndarray
    b: np.ndarray

    @classmethod
    def of(cls, a: Series, b: Series) -> Self:
        """Returns the samples of two series at the times that both have."""
        in_ns = [np.rint(1e9 * series.times).astype(np.int64) for series in (a, b)]
        _, in_a, in_b = np.intersect1d(in_ns[0], in_ns[1], return_indices=True)
        return cls(a.times[in_a], a.values[in_a], b.values[in_b])

    def differences(self, shift: float = 0.0) -> np.ndarray:
        """Returns the absolute differences (T, n).

        They are zero where neither value is finite, and infinite where only one is.

        Args:
            shift: How much earlier or later either may be [s]. Each value is then compared with the
                range of the other run's values within that time: what counts is how far the value
                is outside, element by element, and in the run in which that is more.
        """
        known = np.isfinite(self.a), np.isfinite(self.b)
        both = known[0] & known[1]
        found = np.zeros(self.a.shape)
        for one, other, finite in ((self.a, self.b, known[1]), (self.b, self.a, known[0])):
            lowest, highest = self._bounds(other, finite, shift)
            value = np.where(both, one, 0.0)
            found = np.maximum(found, np.maximum(value - highest, lowest - value))
        return np.where(both, found, np.where(known[0] != known[1], np.inf, 0.0))

    def _bounds(
        self, values: np.ndarray, finite: np.ndarray, shift: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the extremes (T, n) of the finite values within `shift` [s] of each sample."""
        reach = shift + _ROUNDING
        first = np.searchsorted(self.times, self.times - reach)
        last = np.searchsorted(self.times, self.times + reach, side="right")
        # `reduceat` reduces from each index to the next; every other result is a window's. A row
        # that changes nothing makes the end of the last window a valid index.
        windows = np.column_stack([first, last]).ravel()
        padded = [
            np.vstack([np.where(finite, values, unknown), np.full((1, values.shape[1]), unknown)])
            for unknown in (np.inf, -np.inf)
        ]
        return (
            np.minimum.reduceat(padded[0], windows)[::2],
            np.maximum.reduceat(padded[1], windows)[::2],
        )
