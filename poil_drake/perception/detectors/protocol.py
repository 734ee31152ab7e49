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
        object_masks: V masks (H, W) bool, one per view; all False if the view shows no object.
        part_masks: V masks (H, W) bool of the part, each a subset of the view's object mask.
    """

    object_masks: tuple[np.ndarray, ...]
    part_masks: tuple[np.ndarray, ...]


class Detector(Protocol):
    """Finds an object and its functional part in the views of one instant."""

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the object and of its part in each view.

        Args:
            frame: The views.
            object_label: Name of the object, e.g. "mug".
            part_label: Name of the part of the object, e.g. "handle".

        Raises:
            DetectionError: if a name is unknown, or if the views show too little of the part.
        """
