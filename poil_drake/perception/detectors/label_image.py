"""The detector that reads label images, a baseline for the others."""

import difflib
from collections.abc import Iterable

import numpy as np

from poil_drake.errors import DetectionError
from poil_drake.geometry.depth_image import COARSE_PIXEL, pixel_size
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import MultiViewFrame, RgbdImage

_MIN_PART_PIXELS, _MIN_COARSE_PIXELS = 60, 15
"""Least number of a part's pixels in all views together, with fine and with coarse pixels. With
fewer, too little would remain of the part after its masks are eroded; coarse ones are not."""


class LabelImageDetector:
    """Reads masks from label images, as a baseline for other detectors; a `Detector`.

    At least one image of a frame must have a `label`, and the frame must have `label_ids`. Where an
    image has no label, its masks are empty.
    """

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the object and of its part in each view; see `Detector.detect`.

        Raises:
            DetectionError: if labels are missing or unknown, or if too few pixels show the part.
        """
        count = sum(image.label is not None for image in frame.images)
        if not count or not frame.label_ids:
            raise DetectionError(
                f"The detector 'label_image' needs render labels, but {count} of "
                f"{len(frame.images)} images have labels, and `label_ids` has "
                f"{len(frame.label_ids)} names.",
                remedy="Use a simulation, or a recording with the metadata 'label_ids' and a topic "
                "/camera/<name>/label with an image at most 1 s from the first complete frame.",
            )
        object_ids = _ids(frame, object_label)
        part_ids = _ids(frame, f"{object_label}/{part_label}")
        part_masks = tuple(_mask(image, part_ids) for image in frame.images)
        seen = sum(int(mask.sum()) for mask in part_masks)
        coarse = all(
            not pixel_size(mask, image.depth, camera.K) <= COARSE_PIXEL
            for camera, image, mask in zip(frame.cameras, frame.images, part_masks, strict=True)
        )
        needed = _MIN_COARSE_PIXELS if coarse else _MIN_PART_PIXELS
        if seen < needed:
            labels = [image.label for image in frame.images if image.label is not None]
            found = sorted({int(n) for label in labels for n in np.unique(label)})
            others = f" The part has the label {_text(part_ids)}; there are {_text(found[:10])}."
            raise DetectionError(
                f"The views show only {seen} pixels of the part '{part_label}' of "
                f"'{object_label}', but {needed} are needed.{'' if seen else others}",
                remedy="Turn the object, add a camera that sees the part, move a camera nearer, or "
                "use images of more pixels.",
            )
        return PartMasks(
            object_masks=tuple(_mask(image, object_ids) for image in frame.images),
            part_masks=part_masks,
        )


def _mask(image: RgbdImage, ids: tuple[int, ...]) -> np.ndarray:
    if image.label is None:
        return np.zeros(image.depth.shape, dtype=bool)
    return np.isin(image.label, ids)


def _text(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))


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
