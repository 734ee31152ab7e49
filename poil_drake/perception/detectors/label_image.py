"""Finds parts by the render labels that a simulator gives: the baseline of all detectors."""

import difflib
from dataclasses import dataclass

import numpy as np

from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import MultiViewFrame


@dataclass(frozen=True, kw_only=True)
class LabelImageDetectorConfig:
    """What counts as seen.

    Attributes:
        min_part_pixels: A part with fewer pixels in all views together is not seen [px]; masks
            lose a rim of some pixels when they are eroded.
    """

    min_part_pixels: int = 60


class LabelImageDetector:
    """Reads masks off label images. It needs frames with `label` images and `label_ids`."""

    def __init__(self, config: LabelImageDetectorConfig | None = None):
        """Keeps the configuration.

        Args:
            config: What counts as seen.
        """
        self._config = config or LabelImageDetectorConfig()

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the object and of the part in each view.

        Raises:
            DetectionError: if the frame has no label images, a label is unknown, or the part is
                seen in no view.
        """
        labels = [image.label for image in frame.images if image.label is not None]
        if len(labels) < len(frame.images) or not frame.label_ids:
            raise DetectionError(
                "The images carry no render labels, which the detector 'label_image' reads.",
                remedy="Use frames of a simulation that were taken with labels; in a recording "
                "these are the topics /camera/<name>/label and the metadata 'label_ids'.",
            )
        object_ids = _ids(frame, object_label)
        part_ids = _ids(frame, f"{object_label}/{part_label}")
        part_masks = tuple(np.isin(label, part_ids) for label in labels)
        seen = sum(int(mask.sum()) for mask in part_masks)
        if seen < self._config.min_part_pixels:
            raise DetectionError(
                f"The part '{part_label}' of '{object_label}' is seen in no view: {seen} pixels "
                f"of {self._config.min_part_pixels} needed.",
                remedy="Turn the object, or add a camera that sees the part.",
            )
        return PartMasks(
            object_masks=tuple(np.isin(label, object_ids) for label in labels),
            part_masks=part_masks,
        )


def _ids(frame: MultiViewFrame, label: str) -> tuple[int, ...]:
    if label in frame.label_ids:
        return frame.label_ids[label]
    kind, name = ("part", label.split("/", 1)[1]) if "/" in label else ("object", label)
    owner = f"{label.split('/', 1)[0]}/" if kind == "part" else ""
    known = sorted(
        key.removeprefix(owner)
        for key in frame.label_ids
        if key.startswith(owner) and "/" not in key.removeprefix(owner)
    )
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"Did you mean '{close[0]}'? " if close else ""
    raise DetectionError(
        f"The images label no {kind} '{name}'.",
        remedy=f"{hint}Known: {', '.join(known) or 'none'}.",
    )
