"""What the network's numbers are measured in."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from poil_drake.benchmarks.control.point_policy.windows import Windows

_SMALLEST_HALF_RANGE = 1e-3
"""What keeps an axis along which the data hardly differ from dividing by zero, and noise along it
from being blown up [m]."""


@dataclass(frozen=True, eq=False)
class Normalization:
    """The box that the data fill, which is mapped to the cube from -1 to 1.

    Past and future positions are absolute and measured alike, by the smallest and largest
    coordinates of all points in all demonstrations, as published. There the box is mapped to the
    cube from 0 to 1; linear layers with biases read and write the numbers, so that what can be
    represented is the same, and training starts in the middle of the data.

    Attributes:
        lower: (3,) smallest coordinates in the data [m, world].
        upper: (3,) largest ones.
    """

    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, windows: Windows) -> Self:
        """Returns the statistics of demonstrations."""
        now = windows.histories[:, -1]
        return cls(now.min(axis=(0, 1)), now.max(axis=(0, 1)))

    def inputs(self, histories: np.ndarray) -> np.ndarray:
        """Returns the network's inputs (..., N, 3 H), float32, for histories (..., H, N, 3) [m]."""
        return self._numbers(histories)

    def targets(self, futures: np.ndarray) -> np.ndarray:
        """Returns the outputs wanted (..., N, 3 K), float32, for futures (..., K, N, 3) [m]."""
        return self._numbers(futures)

    def positions(self, outputs: np.ndarray) -> np.ndarray:
        """Returns the positions (K, N, 3) [m, world] that outputs (N, 3 K) mean."""
        numbers = outputs.reshape(len(outputs), -1, 3).swapaxes(0, 1)
        return self._center() + self._half_range() * numbers

    def _numbers(self, positions: np.ndarray) -> np.ndarray:
        """Returns positions (..., L, N, 3) [m, world] as numbers (..., N, 3 L), float32."""
        numbers = (positions - self._center()) / self._half_range()
        per_point = np.swapaxes(numbers, -3, -2)
        return per_point.reshape(*per_point.shape[:-2], -1).astype(np.float32)

    def _center(self) -> np.ndarray:
        return 0.5 * (self.lower + self.upper)

    def _half_range(self) -> np.ndarray:
        return np.maximum(0.5 * (self.upper - self.lower), _SMALLEST_HALF_RANGE)
