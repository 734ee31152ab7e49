import re

import numpy as np
import pytest

from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.by_name.detector import NamedDetector
from poil_drake.perception.detectors.by_name.protocol import Boxes
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.segmenters.protocol import box_mask

HEIGHT, WIDTH = SIZE = (120, 160)
RED, GREEN = (200, 0, 0), (0, 200, 0)
MUG, HANDLE = (slice(30, 90), slice(40, 100)), (slice(50, 70), slice(80, 100))
CAMERA = CameraModel("left", WIDTH, HEIGHT, np.diag([100.0, 100.0, 1.0]), np.eye(4))


def view(*, mug: bool = True, handle: bool = True) -> RgbdImage:
    """Returns a red mug with a green handle before a black background."""
    rgb = np.zeros((*SIZE, 3), dtype=np.uint8)
    if mug:
        rgb[MUG] = RED
    if handle:
        rgb[HANDLE] = GREEN
    return RgbdImage(rgb, np.ones(SIZE), stamp=0.0)


class ColourFinder:
    """Finds one box around all pixels of a colour; keeps the queries."""

    def __init__(self) -> None:
        self.queries: list[tuple[str, tuple[int, int]]] = []

    def find(self, image: np.ndarray, label: str) -> Boxes:
        self.queries.append((label, image.shape[:2]))
        pixels = image.max(axis=2) > 150 if label == "red mug" else image[:, :, 1] > 150
        # The margin around the mug is no handle: of grey, only the border has green.
        pixels &= image[:, :, 2] < 100
        size = image.shape[:2]
        if not pixels.any():
            return Boxes.in_image([], size)
        v, u = np.nonzero(pixels)
        return Boxes.in_image([[u.min(), v.min(), u.max() + 1, v.max() + 1]], size)


class CellFinder(ColourFinder):
    """Finds a box around the handle in each cell of a grid of two cells."""

    def find(self, image: np.ndarray, label: str) -> Boxes:
        if label == "red mug" or image.shape[0] == image.shape[1]:
            return super().find(image, label)
        half = image.shape[1] // 2
        left, right = super().find(image[:, :half], label), super().find(image[:, half:], label)
        corners = np.vstack([left.corners, right.corners + np.array([half, 0, half, 0])])
        return Boxes.in_image(corners, image.shape[:2])


class BoxSegmenter:
    """Fills boxes."""

    def segment(self, image, camera, boxes, within=None):
        masks = np.stack([box_mask(box, image.depth.shape) for box in boxes])
        return masks if within is None else masks & within


def detect(
    *views: RgbdImage, finder: ColourFinder | None = None, one_grid: bool = True
) -> PartMasks:
    frame = MultiViewFrame((CAMERA,) * len(views), views)
    words = {"mug_7": "red mug"}
    dut = NamedDetector(finder or CellFinder(), BoxSegmenter(), words=words, one_grid=one_grid)
    return dut.detect(frame, object_label="mug_7", part_label="handle")


def check_masks(masks: PartMasks, view: int) -> None:
    """Checks the masks of a view that shows both: up to a pixel, because crops are enlarged."""
    whole, part = (np.zeros(SIZE, dtype=bool) for _ in range(2))
    whole[MUG], part[HANDLE] = True, True
    np.testing.assert_array_equal(masks.object_masks[view], whole)
    assert np.count_nonzero(masks.part_masks[view] != part) <= 4 * 22
    assert not (masks.part_masks[view] & ~whole).any()


@pytest.mark.parametrize("one_grid", [True, False])
def test_object_and_part_are_found_in_each_view(one_grid: bool) -> None:
    masks = detect(view(), view(), one_grid=one_grid)

    for k in range(2):
        check_masks(masks, k)


def test_one_query_shows_the_part_in_all_views() -> None:
    finder = CellFinder()

    detect(view(), view(mug=False, handle=False), view(), finder=finder)

    objects = [("red mug", SIZE)] * 3
    # The queries for the part are the halves of one image.
    assert [label for label, _ in finder.queries] == ["red mug"] * 3 + ["handle"] * 2
    assert finder.queries[:3] == objects


def test_without_a_grid_each_view_has_a_query_of_its_own() -> None:
    finder = ColourFinder()

    detect(view(), view(mug=False, handle=False), view(), finder=finder, one_grid=False)

    assert [label for label, _ in finder.queries] == ["red mug"] * 3 + ["handle"] * 2


def test_views_without_object_or_part_have_empty_masks() -> None:
    masks = detect(view(mug=False, handle=False), view(handle=False), view(), finder=CellFinder())

    assert [bool(mask.any()) for mask in masks.object_masks] == [False, True, True]
    assert [bool(mask.any()) for mask in masks.part_masks] == [False, False, True]


def test_no_object_in_any_view_is_an_error() -> None:
    with pytest.raises(DetectionError, match="no 'red mug' in any view"):
        detect(view(mug=False, handle=False))


def test_no_part_in_any_view_is_an_error() -> None:
    with pytest.raises(DetectionError, match=re.escape("no 'handle' on the 'red mug'")):
        detect(view(handle=False), view(handle=False))
