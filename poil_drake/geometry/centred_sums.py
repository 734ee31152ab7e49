"""Points, and vectors at them, about their means, and the sums that rigid fits need."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

_ONES = np.ones(3)


class CentredSums(NamedTuple):
    """N points x_i and k - 1 vectors at each, in one array so that each step is one operation.

    Attributes:
        total: The sum of the weights w_i.
        mean: (3k,) weighted means.
        centred: (N, 3k) points and vectors less the means; r_i in the first three columns.
        sums: 3 rows of 3k floats: the sums of w_i r_i r_i^T, w_i r_i v_i^T, ...
    """

    total: float
    mean: np.ndarray
    centred: np.ndarray
    sums: list[list[float]]

    def combine(self, factors: tuple[float, ...]) -> np.ndarray:
        """Returns squared lengths (N,) of r_i^T F_1 + v_i^T F_2 + ..., with F_1, ... (3, 3).

        Args:
            factors: The numbers of the first F, row by row; the remaining F are zero.
        """
        missing = 3 * len(self.mean) - len(factors)
        matrix = np.array(factors + (0.0,) * missing).reshape(-1, 3)
        combined = self.centred.dot(matrix)
        return (combined * combined).dot(_ONES)


def centred_sums(vectors: tuple[np.ndarray, ...], weights: np.ndarray | None = None) -> CentredSums:
    """Returns the weighted means of k sets of vectors, the vectors about them, and their sums.

    Args:
        vectors: k arrays (N, 3), the points first.
        weights: (N,) non-negative, not all zero; None for all one.
    """
    centred = np.concatenate(vectors, axis=1)
    if weights is None:
        total = float(len(centred))
        # Subtracting a full matrix takes a fraction of the time of broadcasting a row.
        means = _averaging(len(centred)).dot(centred)
        centred -= means
        mean, weighted = means[0], centred[:, :3].T
    else:
        total = sum(weights.tolist())
        mean = weights.dot(centred) / total
        centred -= mean
        weighted = centred[:, :3].T * weights
    mean.setflags(write=False)
    return CentredSums(total, mean, centred, weighted.dot(centred).tolist())


@lru_cache(maxsize=32)
def _averaging(count: int) -> np.ndarray:
    return np.full((count, count), 1.0 / count)
