"""Finds objects and parts by their names."""

from collections.abc import Mapping, Sequence

import numpy as np

from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.by_name.grid_prompt import make_grid
from poil_drake.perception.detectors.by_name.protocol import Boxes, BoxFinder
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.segmenters.protocol import Segmenter


class NamedDetector:
    """Finds the object in each view, then its part in the crops of all views; a `Detector`."""

    def __init__(
        self,
        finder: BoxFinder,
        segmenter: Segmenter,
        *,
        words: Mapping[str, str] | None = None,
        one_grid: bool = True,
    ):
        """Constructs the detector.

        Args:
            finder: Finds boxes.
            segmenter: Turns boxes into masks.
            words: Label -> words that describe it to the finder; labels describe themselves.
            one_grid: Whether one query shows the crops of all views; otherwise there is a query for
                each view.
        """
        self._finder, self._segmenter = finder, segmenter
        self._words, self._one_grid = words or {}, one_grid

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the object and of its part in each view; see `Detector.detect`."""
        thing, part = (self._words.get(label, label) for label in (object_label, part_label))
        images = [image.rgb for image in frame.images]
        objects = [self._finder.find(image, thing).best() for image in images]
        if all(box is None for box in objects):
            raise DetectionError(
                f"The model sees no '{thing}' in any view.",
                remedy="Describe it in other words (words of the detector's configuration), or "
                "turn a camera towards it.",
            )
        parts = [boxes.best() for boxes in self._part_boxes(images, objects, part)]
        object_masks, part_masks = zip(
            *map(self._masks, frame.images, frame.cameras, objects, parts), strict=True
        )
        if not any(mask.any() for mask in part_masks):
            raise DetectionError(
                f"The model sees no '{part}' on the '{thing}' in any view.",
                remedy="Describe it in other words (words of the detector's configuration), turn "
                "the object, or add a camera that sees the part.",
            )
        return PartMasks(object_masks, part_masks)

    def _part_boxes(
        self, images: Sequence[np.ndarray], objects: Sequence[np.ndarray | None], part: str
    ) -> list[Boxes]:
        """Returns the boxes of the part in each view."""
        shown = [objects]
        if not self._one_grid:
            shown = [
                [box if k == view else None for k in range(len(images))]
                for view, box in enumerate(objects)
                if box is not None
            ]
        sizes = [image.shape[:2] for image in images]
        found = [Boxes.in_image([], size) for size in sizes]
        for boxes in shown:
            grid = make_grid(images, boxes)
            in_views = grid.boxes_in_views(self._finder.find(grid.image, part), sizes)
            for cell in grid.cells:
                found[cell.view] = in_views[cell.view]
        return found

    def _masks(
        self,
        image: RgbdImage,
        camera: CameraModel,
        thing: np.ndarray | None,
        part: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the masks (H, W) of the object and the part in one view, given their boxes."""
        nothing = np.zeros(image.depth.shape, dtype=bool)
        if thing is None:
            return nothing, nothing
        object_mask = self._segmenter.segment(image, camera, thing[None])[0]
        if part is None:
            return object_mask, nothing
        return object_mask, self._segmenter.segment(image, camera, part[None], object_mask)[0]
