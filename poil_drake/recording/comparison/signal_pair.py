"""Differences between two runs' samples of the same signal."""

from typing import NamedTuple, Self

import numpy as np

from poil_drake.recording.run_log.series import ROUNDING, Series


class SignalPair(NamedTuple):
    """The samples of a signal in two runs, at the times that both runs have.

    Attributes:
        times: (T,) sample times [s], sorted.
        a: (T, n) values of the signal in the first run.
        b: (T, n) values of the signal in the second run.
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
        """Returns the (T, n) absolute differences.

        They are zero where neither value is finite, and infinite where only one value is finite.

        Args:
            shift: Time by which either run may be earlier or later [s]. Each value is compared with
                the range of the other run's values within `shift` of its time. Of the two distances
                at a time, the difference is the larger one.
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
        """Returns (T, n) minima and maxima of `values`, where `finite`, up to `shift` [s] away."""
        reach = shift + ROUNDING
        first = np.searchsorted(self.times, self.times - reach)
        last = np.searchsorted(self.times, self.times + reach, side="right")
        # `reduceat` reduces from each index to the next; every other result is that of a window. A
        # neutral last row makes the end of the last window a valid index.
        windows = np.column_stack([first, last]).ravel()
        padded = [
            np.vstack([np.where(finite, values, unknown), np.full((1, values.shape[1]), unknown)])
            for unknown in (np.inf, -np.inf)
        ]
        return (
            np.minimum.reduceat(padded[0], windows)[::2],
            np.maximum.reduceat(padded[1], windows)[::2],
        )
