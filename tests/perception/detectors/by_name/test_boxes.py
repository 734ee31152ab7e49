import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from poil_drake.perception.detectors.by_name.protocol import Boxes

SIZE = (60, 80)


def test_exchanged_edges_are_put_right_and_boxes_are_clipped() -> None:
    dut = Boxes.in_image([[30, 20, 10, 5], [-5, 50, 100, 70]], SIZE)

    np.testing.assert_array_equal(dut.corners, [[10, 5, 30, 20], [0, 50, 80, 60]])


def test_boxes_without_area_in_the_image_and_duplicates_are_dropped() -> None:
    box = [10, 5, 30, 20]
    flat, outside = [10, 5, 30, 5], [90, 10, 100, 20]

    dut = Boxes.in_image([flat, box, outside, box], SIZE, scores=[0.4, 0.3, 0.2, 0.1])

    np.testing.assert_array_equal(dut.corners, [box])
    np.testing.assert_array_equal(dut.scores, [0.3])


@given(arrays(float, (3, 4), elements=st.floats(width=32)), arrays(float, 3))
def test_whatever_a_model_says_the_boxes_are_in_the_image(
    corners: np.ndarray, scores: np.ndarray
) -> None:
    dut = Boxes.in_image(corners, SIZE, scores)

    assert np.all(dut.corners[:, :2] < dut.corners[:, 2:])
    assert np.all((dut.corners >= 0) & (dut.corners <= [80, 60, 80, 60]))


def test_the_best_box_has_the_highest_score_then_the_largest_area() -> None:
    small, large = [0, 0, 9, 9], [0, 0, 10, 10]

    assert Boxes.in_image([small, large], SIZE, [0.9, 0.8]).best().tolist() == small
    assert Boxes.in_image([small, large], SIZE).best().tolist() == large
    assert Boxes.in_image([], SIZE).best() is None
