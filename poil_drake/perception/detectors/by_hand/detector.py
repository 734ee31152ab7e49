"""The detector that uses boxes and clicks made by hand."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.by_hand.hand_labels import ROLES, HandLabels
from poil_drake.perception.detectors.by_hand.marked_regions import part_masks, region_masks
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import MultiViewFrame

OBJECT, PART, FIXTURE = ROLES


def hand_label_masks(frame: MultiViewFrame, labels: HandLabels) -> dict[str, dict[str, np.ndarray]]:
    """Returns the masks (H, W) bool of object, part and fixture, by role and camera.

    The masks of a role without marks are all False.

    Args:
        frame: The views that the labels were made on.
        labels: The boxes and clicks.
    """
    objects = region_masks(frame, labels, OBJECT)
    masks = {
        OBJECT: objects,
        PART: part_masks(frame, labels, PART, objects),
        FIXTURE: region_masks(frame, labels, FIXTURE),
    }
    names = [camera.name for camera in frame.cameras]
    return {role: dict(zip(names, found, strict=True)) for role, found in masks.items()}


class HandLabelDetector:
    """Finds object and part by boxes and clicks that a person made on the same scene.

    A `Detector`. Labels fit one scene each, so a transfer needs those of the demonstration and
    those of the target; the detector takes the file whose images the frame shows.
    """

    def __init__(self, paths: Iterable[str | Path]):
        """Loads the labels.

        Args:
            paths: Files that `poil label` wrote, at least one.

        Raises:
            LabelError: if a file is missing or damaged.
        """
        self._labels = {Path(path): HandLabels.load(path) for path in paths}

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the marked object and part in each view; see `Detector.detect`.

        Args:
            frame: The views.
            object_label: Name of the object, for errors.
            part_label: Name of the part, for errors.

        Raises:
            DetectionError: if no file was made on these views, or object or part are not marked.
        """
        path, labels = self._labels_of(frame)
        found = hand_label_masks(frame, labels)
        masks = {role: tuple(views.values()) for role, views in found.items()}
        for role, name in ((OBJECT, object_label), (PART, f"{object_label}/{part_label}")):
            if not any(mask.any() for mask in masks[role]):
                raise DetectionError(
                    f"The labels '{path}' mark no pixel of the {role}, '{name}', that has depth.",
                    remedy=f"Draw a box around the {role} with `poil label`.",
                )
        return PartMasks(object_masks=masks[OBJECT], part_masks=masks[PART])

    def _labels_of(self, frame: MultiViewFrame) -> tuple[Path, HandLabels]:
        others = {path: labels.other_views(frame) for path, labels in self._labels.items()}
        for path, labels in self._labels.items():
            if not others[path]:
                return path, labels
        listed = "; ".join(f"'{path}' ({', '.join(views)})" for path, views in others.items())
        raise DetectionError(
            f"The labels made by hand belong to other images: {listed}.",
            remedy="Restore the scene, or label it again with `poil label`.",
        )
