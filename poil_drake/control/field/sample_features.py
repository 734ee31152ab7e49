"""Precomputed terms of the squared distances to the samples of a trajectory."""

from dataclasses import dataclass

import numpy as np

_EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class SampleFeatures:
    """The terms of the squared distances to T samples that do not depend on the points.

    With c the mean of all positions and z_i = x*_i - c, half the squared distance is

        |x_i - x*_i|^2 / 2 = |x_i - c|^2 / 2 - x_i . z_i + (|z_i|^2 / 2 + c . z_i),

    whose first term is the same for all samples, so a weighted sum over the points takes two small
    matrix products. Using z_i instead of x*_i keeps the terms and their rounding errors small far
    from the world's origin.

    Attributes:
        offsets: (3N, T) z_i [m].
        constants: (N, T) |z_i|^2 / 2 + c . z_i [m^2].
        summed_constants: (T,) the sum of these over the points [m^2].
        stacked: (4N, T) `offsets` above `constants`.
        sizes: (N,) |c|^2 plus the largest |z_i|^2 of all samples [m^2], for the rounding errors.
        summed_sizes: The sum of these over the points [m^2].
        tolerance_factor: Largest difference of equal costs by rounding, as a fraction of
            sum_i w_i (|x_i|^2 + sizes_i). The terms of a cost add up to at most 3/2 of that, and so
            do those of `squared_distances`. A sum of 4N terms rounds by less than 4N + 8 times half
            an epsilon, and two sums of each kind are compared.
        steps: (T - 1, 3N) from each sample to the next [m].
        squared_steps: (T - 1,) their squared lengths, all points' together [m^2].
    """

    offsets: np.ndarray
    constants: np.ndarray
    summed_constants: np.ndarray
    stacked: np.ndarray
    sizes: np.ndarray
    summed_sizes: float
    tolerance_factor: float
    steps: np.ndarray
    squared_steps: np.ndarray

    @classmethod
    def of(cls, positions: np.ndarray) -> "SampleFeatures":
        """Computes the features of positions (T, N, 3) [m]."""
        T, N, _ = positions.shape
        centre = positions.mean(axis=(0, 1))
        offsets = positions - centre
        squares = np.vecdot(offsets, offsets)
        constants = 0.5 * squares + offsets @ centre
        stacked = np.concatenate([offsets.reshape(T, -1), constants], axis=1).T.copy()
        sizes = squares.max(axis=0) + centre @ centre
        summed_constants = constants.sum(axis=1)
        steps = np.diff(positions.reshape(T, -1), axis=0)
        squared_steps = np.vecdot(steps, steps)
        for values in (stacked, sizes, summed_constants, steps, squared_steps):
            values.flags.writeable = False
        return cls(
            offsets=stacked[: 3 * N],
            constants=stacked[3 * N :],
            summed_constants=summed_constants,
            stacked=stacked,
            sizes=sizes,
            summed_sizes=float(sizes.sum()),
            tolerance_factor=3.0 * (4 * N + 8) * _EPSILON,
            steps=steps,
            squared_steps=squared_steps,
        )

    def relative_costs(
        self, points: np.ndarray, weights: np.ndarray | None = None
    ) -> tuple[np.ndarray, float]:
        """Returns sum_i w_i |x_i - x*_i|^2 / 2 (T,) [m^2] up to a constant, and its rounding error.

        Args:
            points: (N, 3) [m], finite.
            weights: (N,) non-negative, None for all one.

        Returns:
            costs: (T,).
            tolerance: Bound on the summed rounding errors of two costs and `squared_distances`.
        """
        x = points.ravel()
        if weights is None:
            costs = self.summed_constants - x.dot(self.offsets)
            return costs, self.tolerance_factor * float(x.dot(x) + self.summed_sizes)
        weighted = x * np.repeat(weights, 3)
        costs = weights.dot(self.constants) - weighted.dot(self.offsets)
        size = float(x.dot(weighted) + weights.dot(self.sizes))
        return costs, self.tolerance_factor * size
