"""The protocol of models that find objects in an image by their name."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields

_SMALLEST_SIDE = 1.0
"""A box that is narrower or lower than this has no area [px]."""


@dataclass(frozen=True, eq=False)
class Boxes(SharedOnCopy):
    """Boxes in an image, without any order.

    Attributes:
        corners: (n, 4) left, top, right and bottom edge [px]; the image is from 0 to its width and
            height.
        scores: (n,) how sure the model is; equal for all if it does not say so.
    """

    corners: np.ndarray
    scores: np.ndarray

    def __post_init__(self) -> None:
        freeze_fields(self, corners=("n", 4), scores=("n",))

    @classmethod
    def in_image(
        cls, corners: npt.ArrayLike, size: tuple[int, int], scores: npt.ArrayLike | None = None
    ) -> "Boxes":
        """Returns the usable boxes of a model's answer.

        Exchanged edges are put right, and boxes are clipped to the image. Duplicates, and boxes
        without area in the image, are dropped.

        Args:
            corners: (n, 4) boxes [px], which may be infinite or NaN.
            size: Height and width of the image [px].
            scores: (n,); None for equal scores.
        """
        found = np.asarray(corners, dtype=float).reshape(-1, 4)
        values = np.ones(len(found)) if scores is None else np.asarray(scores, dtype=float)
        height, width = size
        low, high = np.minimum(found[:, :2], found[:, 2:]), np.maximum(found[:, :2], found[:, 2:])
        found = np.clip(np.hstack([low, high]), 0.0, [width, height, width, height])
        usable = np.all(found[:, 2:] - found[:, :2] >= _SMALLEST_SIDE, axis=1)  # False for NaN.
        usable &= np.isfinite(values)
        found, values = found[usable], values[usable]
        _, first = np.unique(found, axis=0, return_index=True)
        first.sort()
        return cls(found[first], values[first])

    def best(self) -> np.ndarray | None:
        """Returns the box (4,) with the highest score, the largest one of equals; None if none."""
        if not len(self.corners):
            return None
        areas = np.prod(self.corners[:, 2:] - self.corners[:, :2], axis=1)
        return self.corners[np.lexsort((areas, self.scores))[-1]]


class BoxFinder(Protocol):
    """Finds what a name describes in an image."""

    def find(self, image: np.ndarray, label: str) -> Boxes:
        """Returns boxes around everything that the name describes; none if nothing is seen.

        Args:
            image: (H, W, 3) uint8 colour.
            label: What to find, in words, e.g. "mug".

        Raises:
            DetectionError: if the model gives no usable answer.
        """
