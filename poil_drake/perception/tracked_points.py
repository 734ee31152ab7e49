"""The result of a point tracker."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields


@dataclass(frozen=True, eq=False)
class TrackedPoints(SharedOnCopy):
    """The positions of N points at one instant.

    Attributes:
        positions: (N, 3) positions [m, world]; NaN where not observed.
        confidence: (N,) in [0, 1]; 0 where not observed.
        stamp: Time of capture of the images that show the points [s].
    """

    positions: np.ndarray
    confidence: np.ndarray
    stamp: float

    def __post_init__(self) -> None:
        freeze_fields(self, finite=False, positions=("N", 3))
        freeze_fields(self, confidence=self.positions.shape[:1])
        confidence = self.confidence
        if np.any((confidence < 0.0) | (confidence > 1.0)):
            raise InvalidValueError(
                f"TrackedPoints.confidence ranges from {confidence.min()} to {confidence.max()}.",
                remedy="Pass values in [0, 1].",
            )
        wrong = np.flatnonzero(~np.isfinite(self.positions).all(axis=1) & (confidence > 0.0))
        if wrong.size:
            raise InvalidValueError(
                f"TrackedPoints has confidence > 0 for points without position: {wrong.tolist()}.",
                remedy="Set the confidence to 0 where the position is not finite.",
            )

    @classmethod
    def lost(cls, count: int, stamp: float) -> "TrackedPoints":
        """Returns `count` points, none of them observed at time `stamp` [s]."""
        return cls(np.full((count, 3), np.nan), np.zeros(count), stamp)
