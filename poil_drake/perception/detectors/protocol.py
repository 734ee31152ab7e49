"""The protocol of part detectors."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import MultiViewFrame


@dataclass(frozen=True, eq=False)
class PartMasks(SharedOnCopy):
    """Masks of an object and of its functional part.

    Attributes:
        object_masks: V arrays (H, W) bool, one per view; all False if it does not show the object.
        part_masks: V arrays (H, W) bool, subsets of `object_masks`.
    """

    object_masks: tuple[np.ndarray, ...]
    part_masks: tuple[np.ndarray, ...]


class Detector(Protocol):
    """Finds an object and its functional part in the views of one instant."""

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the object and of the part in each view.

        Raises:
            DetectionError: if a label is unknown, or the views show too little of the part.
        """
        ...
