"""Detects parts by the render labels of a simulator, as a baseline for other detectors."""

import difflib

import numpy as np

from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import MultiViewFrame

_MIN_PART_PIXELS = 60
"""Least number of a part's pixels in all views together. With fewer, too little would remain of the
part after its masks are eroded."""


class LabelImageDetector:
    """Reads masks from label images; a `Detector`.

    All images of a frame must have a `label`, and the frame must have `label_ids`.
    """

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the object and of its part in each view; see `Detector.detect`.

        Raises:
            DetectionError: if labels are missing or unknown, or if too few pixels show the part.
        """
        labels = [image.label for image in frame.images if image.label is not None]
        if len(labels) < len(frame.images) or not frame.label_ids:
            raise DetectionError(
                f"The detector 'label_image' needs render labels, but {len(labels)} of "
                f"{len(frame.images)} images have labels, and `label_ids` has "
                f"{len(frame.label_ids)} names.",
                remedy="Use a simulation, or a recording with the topics /camera/<name>/label and "
                "the metadata 'label_ids'.",
            )
        object_ids = _ids(frame, object_label)
        part_ids = _ids(frame, f"{object_label}/{part_label}")
        part_masks = tuple(np.isin(label, part_ids) for label in labels)
        seen = sum(int(mask.sum()) for mask in part_masks)
        if seen < _MIN_PART_PIXELS:
            raise DetectionError(
                f"The views show only {seen} pixels of the part '{part_label}' of "
                f"'{object_label}', but {_MIN_PART_PIXELS} are needed.",
                remedy="Turn the object, or add a camera that sees the part.",
            )
        return PartMasks(
            object_masks=tuple(np.isin(label, object_ids) for label in labels),
            part_masks=part_masks,
        )


def _ids(frame: MultiViewFrame, label: str) -> tuple[int, ...]:
    if label in frame.label_ids:
        return frame.label_ids[label]
    owner, _, part = label.rpartition("/")
    prefix = f"{owner}/" if owner else ""
    what = f"part '{part}' of '{owner}'" if owner else f"object '{part}'"
    names = [key.removeprefix(prefix) for key in frame.label_ids if key.startswith(prefix)]
    known = sorted(name for name in names if "/" not in name)
    close = difflib.get_close_matches(part, known, n=1)
    hint = f"Did you mean '{close[0]}'? " if close else ""
    raise DetectionError(
        f"The frame has no render label for the {what}.",
        remedy=f"{hint}Known: {', '.join(known) or 'none'}.",
    )
