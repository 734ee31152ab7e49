"""How two runs' samples of one signal differ."""

from typing import NamedTuple, Self

import numpy as np

from poil_drake.recording.run_log.series import Series


class SignalPair(NamedTuple):
    """What two runs say of a signal, at the times that both have.

    Attributes:
        times: (T,) [s], in order.
        a: (T, n) what the one says.
        b: (T, n) what the other one says.
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
        """Returns how far the two are apart (T, n).

        Zero where neither is finite, and infinite where only one of them is.

        Args:
            shift: Either may do so much earlier or later what the other one does [s]: what counts
                is how far, element by element, each is outside the range of values that the other
                one has within that time, whichever of the two is farther out.
        """
        known = np.isfinite(self.a), np.isfinite(self.b)
        both = known[0] & known[1]
        found = np.zeros(self.a.shape)
        for one, other, finite in ((self.a, self.b, known[1]), (self.b, self.a, known[0])):
            lowest, highest = self._bounds(other, finite, shift)
            beyond = np.maximum(
                np.subtract(one, highest, out=np.zeros_like(found), where=both),
                np.subtract(lowest, one, out=np.zeros_like(found), where=both),
            )
            np.maximum(found, beyond, out=found)
        return np.where(known[0] != known[1], np.inf, found)

    def _bounds(
        self, values: np.ndarray, finite: np.ndarray, shift: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the extremes (T, n) of the finite values around each sample."""
        lowest, highest = np.where(finite, values, np.inf), np.where(finite, values, -np.inf)
        bounds = lowest.copy(), highest.copy()
        for step in range(1, len(values)):
            near = (self.times[step:] - self.times[:-step] <= shift + _ROUNDING)[:, None]
            if not near.any():
                break
            early, late = slice(None, -step), slice(step, None)
            for here, there in ((early, late), (late, early)):
                np.minimum(bounds[0][here], lowest[there], out=bounds[0][here], where=near)
                np.maximum(bounds[1][here], highest[there], out=bounds[1][here], where=near)
        return bounds


_ROUNDING = 1e-9
"""Times written as nanoseconds come back rounded [s]."""
