"""A camera looks straight down from 1 m on a table at z = 0, and on boxes that stand on it."""

import numpy as np
import pytest

from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.perception.segmenters.grab_cut import GrabCutSegmenter

HEIGHT, WIDTH = 240, 320
SIZE = (HEIGHT, WIDTH)
X_WC = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1], [0, 0, 0, 1]])
K = np.array([[400.0, 0, 159.5], [0, 400, 119.5], [0, 0, 1]])
CAMERA = CameraModel("above", WIDTH, HEIGHT, K, X_WC)
MUG = np.s_[80:140, 100:160]
HANDLE = np.s_[100:120, 160:180]
BOX = np.array([[95.0, 75.0, 185.0, 145.0]])
WOOD, WHITE = (150, 110, 70), (230, 230, 225)


def scene(*, colour=WHITE, height=0.08, depth=True) -> tuple[RgbdImage, np.ndarray]:
    """Returns an image of a mug with a handle, and its mask."""
    noise = np.random.default_rng(0).integers(-8, 9, (*SIZE, 3))
    rgb, z = np.full((*SIZE, 3), WOOD), np.full(SIZE, 1.0)
    mask = np.zeros(SIZE, dtype=bool)
    for part in (MUG, HANDLE):
        rgb[part], z[part], mask[part] = colour, 1.0 - height, True
    image = np.clip(rgb + noise, 0, 255).astype(np.uint8)
    return RgbdImage(image, z if depth else np.zeros(SIZE), stamp=0.0), mask


def overlap(first: np.ndarray, second: np.ndarray) -> float:
    return np.count_nonzero(first & second) / np.count_nonzero(first | second)


def test_colour_alone_tells_an_object() -> None:
    image, mask = scene(depth=False)

    found = GrabCutSegmenter().segment(image, CAMERA, BOX)

    assert found.shape == (1, *SIZE)
    assert overlap(found[0], mask) > 0.97


def test_the_table_tells_an_object_of_its_colour() -> None:
    image, mask = scene(colour=WOOD)

    found = GrabCutSegmenter(table_height=0.0).segment(image, CAMERA, BOX)[0]

    assert overlap(found, mask) > 0.9


def test_nothing_above_the_table_is_nothing() -> None:
    image, _ = scene(height=0.004)

    assert not GrabCutSegmenter(table_height=0.0).segment(image, CAMERA, BOX).any()


def test_what_is_far_behind_is_no_part_of_the_object() -> None:
    image, mask = scene(height=0.5)  # The box is 0.11 m wide at 0.5 m.
    rgb = image.rgb.copy()
    rgb[120:140, 160:180] = WHITE  # On the table.
    image = RgbdImage(rgb, image.depth, stamp=0.0)

    found = GrabCutSegmenter().segment(image, CAMERA, BOX)[0]

    assert overlap(found, mask) > 0.97


def test_a_box_around_the_whole_image_is_cut_by_the_table() -> None:
    image, mask = scene()
    box = np.array([[0.0, 0.0, WIDTH, HEIGHT]])

    assert overlap(GrabCutSegmenter(table_height=0.0).segment(image, CAMERA, box)[0], mask) > 0.97


def test_a_box_that_is_full_of_the_object_is_the_mask() -> None:
    image = RgbdImage(np.full((*SIZE, 3), WHITE), np.full(SIZE, 0.9), stamp=0.0)
    box = np.array([[0.0, 0.0, WIDTH, HEIGHT]])

    assert GrabCutSegmenter(table_height=0.0).segment(image, CAMERA, box).all()


def test_a_box_of_a_few_pixels_is_the_mask() -> None:
    image, _ = scene()

    found = GrabCutSegmenter().segment(image, CAMERA, np.array([[110.0, 90.0, 112.0, 92.0]]))

    assert np.count_nonzero(found) == 4


def test_only_the_largest_piece_counts() -> None:
    image, mask = scene()
    rgb, depth = image.rgb.copy(), image.depth.copy()
    rgb[80:90, 170:180], depth[80:90, 170:180] = WHITE, 0.92
    image = RgbdImage(rgb, depth, stamp=0.0)

    found = GrabCutSegmenter(table_height=0.0).segment(image, CAMERA, BOX)[0]

    assert not found[80:90, 170:180].any()
    assert overlap(found, mask) > 0.97


def test_the_part_is_what_of_the_object_is_in_its_box() -> None:
    image, mask = scene()
    box = np.array([[160.0, 90.0, 190.0, 130.0]])
    part = np.zeros(SIZE, dtype=bool)
    part[HANDLE] = True

    found = GrabCutSegmenter().segment(image, CAMERA, box, within=mask)

    np.testing.assert_array_equal(found[0], part)


@pytest.mark.parametrize("count", [0, 2])
def test_there_is_one_mask_for_each_box(count: int) -> None:
    image, _ = scene()
    boxes = np.repeat(BOX, count, axis=0)

    found = GrabCutSegmenter(table_height=0.0).segment(image, CAMERA, boxes)

    assert len(found) == count
    assert all(np.array_equal(mask, found[0]) for mask in found)
