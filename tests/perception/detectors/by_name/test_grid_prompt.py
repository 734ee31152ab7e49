import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.perception.detectors.by_name.grid_prompt import BORDER, CELL, make_grid
from poil_drake.perception.detectors.by_name.protocol import Boxes

SIZE = (480, 640)
VIEWS = [np.full((*SIZE, 3), shade, dtype=np.uint8) for shade in (0, 60, 250, 200, 30)]
BOX = np.array([300.0, 200.0, 400.0, 250.0])
GRID_SIZE = (4000, 4000)


def test_all_crops_are_in_one_image_of_equal_cells_with_borders() -> None:
    dut = make_grid(VIEWS[:3], [BOX] * 3)

    pitch = CELL + 2 * BORDER
    assert dut.image.shape == (2 * pitch, 2 * pitch, 3)  # Two columns, and two rows.
    corners = [cell.square[:2] for cell in dut.cells]
    low, high = BORDER, pitch + BORDER
    assert corners == [(low, low), (high, low), (low, high)]
    for cell, shade in zip(dut.cells, (0, 60, 250), strict=True):
        x0, y0, x1, y1 = cell.place
        assert np.all(dut.image[y0:y1, x0:x1] == shade)
        assert np.all(dut.image[y0:y1, x0 - 1] == 127)


def test_a_crop_has_a_margin_and_keeps_its_aspect_ratio() -> None:
    [cell] = make_grid(VIEWS[:1], [BOX]).cells

    # The box has 100 x 50 px: 15 % of that on each side.
    assert cell.crop == (285, 192, 415, 258)
    x0, y0, x1, y1 = cell.place
    assert x1 - x0 == CELL
    assert y1 - y0 == round(CELL * 66 / 130)


def test_a_crop_ends_at_the_edge_of_the_image() -> None:
    [cell] = make_grid(VIEWS[:1], [np.array([0.0, 0.0, 640.0, 480.0])]).cells

    assert cell.crop == (0, 0, 640, 480)


def test_a_view_without_a_box_has_no_cell_and_no_part() -> None:
    dut = make_grid(VIEWS[:3], [BOX, None, BOX])
    everything = Boxes.in_image([cell.place for cell in dut.cells], GRID_SIZE)

    found = dut.boxes_in_views(everything, [SIZE] * 3)

    assert [cell.view for cell in dut.cells] == [0, 2]
    assert [len(boxes.corners) for boxes in found] == [1, 0, 1]


boxes = st.builds(
    lambda x, y, width, height: np.array([x, y, min(x + width, 640.0), min(y + height, 480.0)]),
    *(st.floats(0, 600), st.floats(0, 440), st.floats(8, 640), st.floats(8, 480)),
)


@given(st.lists(boxes, min_size=1, max_size=5), st.data())
def test_a_box_in_a_crop_comes_back_to_its_place_in_the_view(
    objects: list[np.ndarray], data: st.DataObject
) -> None:
    dut = make_grid(VIEWS[: len(objects)], objects)
    view = data.draw(st.integers(0, len(objects) - 1))
    cell, box = dut.cells[view], objects[view]
    # The object's own box, where it appears in the grid.
    scale = (cell.place[2] - cell.place[0]) / (cell.crop[2] - cell.crop[0])
    offset = np.tile(cell.crop[:2], 2)
    in_grid = (box - offset) * scale + np.tile(cell.place[:2], 2)

    found = dut.boxes_in_views(Boxes(in_grid[None], np.array([0.7])), [SIZE] * len(objects))

    # The crop's shorter side is rounded to whole pixels of the grid: up to a share of 1/2 px.
    shorter = min(cell.place[2] - cell.place[0], cell.place[3] - cell.place[1])
    tolerance = 1e-6 + 0.5 / shorter * max(cell.crop[3] - cell.crop[1], cell.crop[2] - cell.crop[0])
    np.testing.assert_allclose(found[view].corners, [box], atol=tolerance)
    assert found[view].scores == [0.7]
    assert sum(len(others.corners) for others in found) == 1


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((100, 200), (CELL + 60, 300)),  # Across the border between two cells.
        ((2, 2), (BORDER - 2, BORDER - 2)),  # In the border.
        ((100, BORDER + 2), (200, BORDER + 50)),  # Above the crop, which is wider than high.
    ],
)
def test_boxes_in_no_single_crop_are_dropped(low: tuple[int, int], high: tuple[int, int]) -> None:
    dut = make_grid(VIEWS[:2], [BOX, BOX])

    found = dut.boxes_in_views(Boxes.in_image([[*low, *high]], GRID_SIZE), [SIZE] * 2)

    assert [len(boxes.corners) for boxes in found] == [0, 0]


def test_a_box_that_reaches_into_the_border_is_clipped_to_its_crop() -> None:
    dut = make_grid(VIEWS[:2], [BOX, BOX])

    found = dut.boxes_in_views(
        Boxes.in_image([[2, 200, CELL + BORDER + 5, 300]], GRID_SIZE), [SIZE] * 2
    )

    assert found[0].corners[0, [0, 2]].tolist() == [285, 415]
