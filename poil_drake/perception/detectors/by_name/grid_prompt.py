"""Multi-view prompting: one query for a part in the crops of all views (paper, section III-A)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.detectors.by_name.protocol import Boxes

MARGIN = 0.15
"""Width of the surroundings shown on each side of an object, as a share of its box's side."""

CELL = 448
"""Height and width of a cell [px]: a multiple of 28, the patch of common models. Four cells have
0.8 megapixels, which they see without shrinking."""

BORDER = 14
"""Width of the border around each cell [px]. Models with 1000 steps of coordinates resolve 1 to
2 px in such a grid, so a box that crosses two borders is in no cell."""

_GREY = 127


@dataclass(frozen=True)
class Cell:
    """The crop of one view, and its place in the grid. Boxes are left, top, right, bottom [px].

    Attributes:
        view: Index of the view.
        crop: The crop's box in the view.
        square: The cell's box in the grid's image, without the border.
        place: The crop's box in the grid's image, inside `square`.
    """

    view: int
    crop: tuple[int, int, int, int]
    square: tuple[int, int, int, int]
    place: tuple[int, int, int, int]

    def in_view(self, box: np.ndarray) -> np.ndarray:
        """Returns the part of a box (4,) of the grid that is in the crop, as a box of the view."""
        place, crop = np.array(self.place).reshape(2, 2), np.array(self.crop).reshape(2, 2)
        inside = np.clip(box.reshape(2, 2), place[0], place[1])
        scale = (crop[1] - crop[0]) / (place[1] - place[0])
        return (crop[0] + (inside - place[0]) * scale).ravel()


@dataclass(frozen=True, eq=False)
class Grid(SharedOnCopy):
    """The crops of several views in one image.

    Attributes:
        image: (H, W, 3) uint8.
        cells: One cell for each view that shows the object.
    """

    image: np.ndarray
    cells: tuple[Cell, ...]

    def boxes_in_views(self, boxes: Boxes, sizes: Sequence[tuple[int, int]]) -> list[Boxes]:
        """Returns the boxes found in the grid as boxes in each view.

        Boxes that reach into several cells, or into none, are dropped; others are clipped to the
        crop in their cell.

        Args:
            boxes: Boxes in the grid's image.
            sizes: Height and width of each view's image [px].
        """
        squares = np.array([cell.square for cell in self.cells])
        corners: list[list[np.ndarray]] = [[] for _ in sizes]
        scores: list[list[float]] = [[] for _ in sizes]
        for box, score in zip(boxes.corners, boxes.scores, strict=True):
            reached = np.all((box[:2] < squares[:, 2:]) & (box[2:] > squares[:, :2]), axis=1)
            if np.count_nonzero(reached) == 1:
                cell = self.cells[reached.argmax()]
                corners[cell.view].append(cell.in_view(box))
                scores[cell.view].append(score)
        return [
            Boxes.in_image(np.array(found), size, np.array(values))
            for found, size, values in zip(corners, sizes, scores, strict=True)
        ]


def make_grid(images: Sequence[np.ndarray], boxes: Sequence[np.ndarray | None]) -> Grid:
    """Returns the crops of all views in one image, in cells of equal size.

    A crop is the object's box with a `MARGIN`. It keeps its aspect ratio and is centred in its
    cell. Views without a box have no cell.

    Args:
        images: The views' images, (H, W, 3) uint8.
        boxes: The object's box (4,) [px] in each view; None if the view does not show it. At least
            one view shows it.
    """
    shown = [(view, box) for view, box in enumerate(boxes) if box is not None]
    columns = math.ceil(math.sqrt(len(shown)))
    rows = math.ceil(len(shown) / columns)
    pitch = CELL + 2 * BORDER
    grid = np.full((rows * pitch, columns * pitch, 3), _GREY, dtype=np.uint8)
    cells = []
    for k, (view, box) in enumerate(shown):
        x0, y0, x1, y1 = crop = _crop(box, images[view].shape)
        scale = CELL / max(x1 - x0, y1 - y0)
        width, height = (max(1, round(scale * side)) for side in (x1 - x0, y1 - y0))
        column, row = k % columns * pitch + BORDER, k // columns * pitch + BORDER
        left, top = column + (CELL - width) // 2, row + (CELL - height) // 2
        shrinks = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
        grid[top : top + height, left : left + width] = cv2.resize(
            images[view][y0:y1, x0:x1], (width, height), interpolation=shrinks
        )
        square, place = (
            (column, row, column + CELL, row + CELL),
            (left, top, left + width, top + height),
        )
        cells.append(Cell(view, crop, square, place))
    return Grid(grid, tuple(cells))


def _crop(box: np.ndarray, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    margin = MARGIN * (box[2:] - box[:2])
    low = np.maximum(np.floor(box[:2] - margin), 0).astype(int)
    high = np.minimum(np.ceil(box[2:] + margin), [shape[1], shape[0]]).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])
