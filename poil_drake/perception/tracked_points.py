"""The result of a point tracker."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array


@dataclass(frozen=True, eq=False)
class TrackedPoints(SharedOnCopy):
    """Positions of N points at one instant.

    Attributes:
        positions: (N, 3) positions [m, world]; NaN where not observed.
        confidence: (N,) in [0, 1]; 0 where not observed.
        stamp: Time of capture of the images [s].
    """

    positions: np.ndarray
    confidence: np.ndarray
    stamp: float

    def __post_init__(self) -> None:
        positions = frozen_array(
            self.positions, name="TrackedPoints.positions", shape=("N", 3), finite=False
        )
        confidence = frozen_array(
            self.confidence, name="TrackedPoints.confidence", shape=(len(positions),)
        )
        if np.any((confidence < 0.0) | (confidence > 1.0)):
            raise InvalidValueError(
                f"TrackedPoints.confidence spans [{confidence.min()}, {confidence.max()}].",
                remedy="Confidence lies in [0, 1].",
            )
        observed = np.isfinite(positions).all(axis=1)
        if np.any(~observed & (confidence > 0.0)):
            raise InvalidValueError(
                "TrackedPoints.positions is not finite at a point with confidence.",
                remedy="Give confidence 0 to points that were not observed.",
            )
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "confidence", confidence)

    @classmethod
    def lost(cls, count: int, stamp: float) -> "TrackedPoints":
        """Returns `count` unobserved points."""
        return cls(np.full((count, 3), np.nan), np.zeros(count), stamp)
