"""What the network's numbers are measured in."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from poil_drake.benchmarks.control.point_policy.windows import Windows

_SMALLEST_LENGTH = 1e-6
"""What keeps data that never move from dividing by zero [m]."""


@dataclass(frozen=True, eq=False)
class Normalization:
    """Statistics of the data: shifted or scaled data give the network the same numbers.

    Attributes:
        center: (3,) mean of the current points [m, world].
        length: Root mean square distance of the current points from it, per axis [m].
        motions: (H - 1,) the same of the points' past displacements from now, oldest first [m].
        futures: (K,) the same of their future displacements [m].
    """

    center: np.ndarray
    length: np.ndarray
    motions: np.ndarray
    futures: np.ndarray

    @classmethod
    def of(cls, windows: Windows) -> Self:
        """Returns the statistics of demonstrations."""
        now = windows.histories[:, -1:]
        center = now.mean(axis=(0, 1, 2))
        return cls(
            center,
            _spread(now - center, axis=(0, 1, 2, 3)),
            _spread(windows.histories[:, :-1] - now, axis=(0, 2, 3)),
            _spread(windows.futures - now, axis=(0, 2, 3)),
        )

    def inputs(self, histories: np.ndarray) -> np.ndarray:
        """Returns the network's inputs (..., N, 3 H), float32, for histories (..., H, N, 3) [m].

        Where each point is, and how it has moved until now.
        """
        now = histories[..., -1:, :, :]
        motions = (histories[..., :-1, :, :] - now) / self.motions[:, None, None]
        numbers = np.concatenate([motions, (now - self.center) / self.length], axis=-3)
        return _per_point(numbers)

    def targets(self, histories: np.ndarray, futures: np.ndarray) -> np.ndarray:
        """Returns the outputs wanted (..., N, 3 K), float32, for futures (..., K, N, 3) [m]."""
        displacements = futures - histories[..., -1:, :, :]
        return _per_point(displacements / self.futures[:, None, None])

    def positions(self, outputs: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Returns the positions (K, N, 3) [m] that outputs (N, 3 K) mean for points (N, 3) [m]."""
        displacements = outputs.reshape(len(now), -1, 3).swapaxes(0, 1)
        return now + displacements * self.futures[:, None, None]


def _spread(values: np.ndarray, *, axis: tuple[int, ...]) -> np.ndarray:
    return np.maximum(np.sqrt(np.mean(values**2, axis=axis)), _SMALLEST_LENGTH)


def _per_point(values: np.ndarray) -> np.ndarray:
    """Returns (..., H, N, 3) as (..., N, 3 H), float32."""
    per_point = np.swapaxes(values, -3, -2)
    return per_point.reshape(*per_point.shape[:-2], -1).astype(np.float32)
