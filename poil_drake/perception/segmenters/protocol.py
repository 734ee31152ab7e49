"""The protocol of segmenters."""

from typing import Protocol

import cv2
import numpy as np

from poil_drake.perception.images import CameraModel, RgbdImage


class Segmenter(Protocol):
    """Finds the pixels of objects in boxes."""

    def segment(
        self,
        image: RgbdImage,
        camera: CameraModel,
        boxes: np.ndarray,
        within: np.ndarray | None = None,
    ) -> np.ndarray:
        """Returns masks (n, H, W) bool, one for each box.

        Each mask is one connected region, or empty. Its border and depth edges are not removed,
        because `fuse_views` does that.

        Args:
            image: The image.
            camera: The camera's model.
            boxes: (n, 4) left, top, right and bottom edge [px].
            within: (H, W) bool mask of the object whose parts the boxes surround. The masks are
                subsets of it. None if the boxes surround whole objects.
        """


def largest_component(mask: np.ndarray) -> np.ndarray:
    """Returns the largest connected region of a mask (H, W) bool; pixels connect diagonally too."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0  # The background.
    return (labels == areas.argmax()) & mask


def box_mask(box: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Returns which pixels of an image of a shape (H, W) a box (4,) [px] touches."""
    (x0, y0), (x1, y1) = np.floor(box[:2]).astype(int), np.ceil(box[2:]).astype(int)
    mask = np.zeros(shape, dtype=bool)
    mask[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = True
    return mask
