"""Masks by OpenCV's GrabCut, seeded with a box, the depth and the table's plane."""

import cv2
import numpy as np

from poil_drake.geometry.depth_image import DepthMaskConfig, clean_mask, unproject
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.perception.segmenters.protocol import box_mask, largest_component

_SURROUNDINGS = 0.5
"""Width of the surroundings from which colours of the background are learned, as a share of the
box's side. More costs time: a whole image of 640 x 480 pixels takes seconds."""

_ABOVE_TABLE = 0.005
"""What is not higher above the table than this is the table [m]: depth noise and calibration."""

_SURFACE = DepthMaskConfig(max_depth=np.inf)

_FEWEST = 10  # pixels from which GrabCut learns five colours

_ITERATIONS = 5  # More change little.


class GrabCutSegmenter:
    """Cuts an object out of its box by colour and depth; a `Segmenter`.

    Pixels outside the box are background, and so are those that are farther behind the object than
    the box is wide. If the table's height is known, its pixels are background, too, and the largest
    surface above it is foreground; colour only decides about the rest. The part of an object is
    what of the object is in the part's box, because its colour is often that of the rest.
    """

    def __init__(self, table_height: float | None = None):
        """Constructs the segmenter.

        Args:
            table_height: Height of the plane on which the objects stand [m, world]; None if it is
                not known.
        """
        self._table_height = table_height

    def segment(
        self,
        image: RgbdImage,
        camera: CameraModel,
        boxes: np.ndarray,
        within: np.ndarray | None = None,
    ) -> np.ndarray:
        """Returns masks (n, H, W) bool; see `Segmenter.segment`."""
        masks = np.zeros((len(boxes), *image.depth.shape), dtype=bool)
        for mask, box in zip(masks, boxes, strict=True):
            inside = box_mask(box, image.depth.shape)
            found = within & inside if within is not None else self._cut(image, camera, box, inside)
            mask[:] = largest_component(found)
        return masks

    def _cut(
        self, image: RgbdImage, camera: CameraModel, box: np.ndarray, inside: np.ndarray
    ) -> np.ndarray:
        """Returns the mask (H, W) of the object in a box, of which `inside` is the mask."""
        background = self._background(image, camera, box, inside)
        labels = np.where(background, cv2.GC_BGD, cv2.GC_PR_FGD).astype(np.uint8)
        if min(np.count_nonzero(background), np.count_nonzero(~background)) < _FEWEST:
            return ~background
        if self._table_height is not None:
            measured = ~background & (image.depth > 0.0)
            surface = largest_component(clean_mask(measured, image.depth, camera.K, _SURFACE))
            labels[surface] = cv2.GC_FGD
        margin = _SURROUNDINGS * (box[2:] - box[:2])
        rows, columns = np.nonzero(
            box_mask(np.hstack([box[:2] - margin, box[2:] + margin]), inside.shape)
        )
        crop = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        labels = np.ascontiguousarray(labels[crop])
        cv2.setRNGSeed(0)  # The clusters of colours start at random.
        bgr = cv2.cvtColor(image.rgb[crop], cv2.COLOR_RGB2BGR)
        cv2.grabCut(bgr, labels, None, None, None, _ITERATIONS, cv2.GC_INIT_WITH_MASK)
        mask = np.zeros_like(inside)
        mask[crop] = (labels == cv2.GC_PR_FGD) | (labels == cv2.GC_FGD)
        return mask

    def _background(
        self, image: RgbdImage, camera: CameraModel, box: np.ndarray, inside: np.ndarray
    ) -> np.ndarray:
        """Returns the pixels outside a box, on the table or far behind the object, (H, W) bool."""
        background = ~inside
        points_C, pixels = unproject(image.depth, camera.K, inside)
        height = points_C @ camera.X_WC[2, :3] + camera.X_WC[2, 3]
        lowest = -np.inf if self._table_height is None else self._table_height + _ABOVE_TABLE
        on_table = height < lowest
        quarter = 0.25 * (box[2:] - box[:2])
        central = np.all((pixels >= box[:2] + quarter) & (pixels < box[2:] - quarter), axis=1)
        depths = points_C[central & ~on_table, 2]
        far = np.zeros_like(on_table)
        if depths.size:
            middle = float(np.median(depths))
            width = middle * float(np.max((box[2:] - box[:2]) / [camera.K[0, 0], camera.K[1, 1]]))
            far = points_C[:, 2] > middle + width
        u, v = pixels[on_table | far].T
        background[v, u] = True
        return background
