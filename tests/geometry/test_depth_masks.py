import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.geometry import depth_masks as dut


def test_erosion_removes_a_border():
    mask = np.zeros((9, 9), dtype=bool)
    mask[2:7, 2:7] = True
    expected = np.zeros((9, 9), dtype=bool)
    expected[3:6, 3:6] = True

    np.testing.assert_array_equal(dut.erode_mask(mask, 0), mask)
    np.testing.assert_array_equal(dut.erode_mask(mask, 1), expected)


def test_mask_is_not_eroded_at_the_image_border():
    assert dut.erode_mask(np.ones((5, 5), dtype=bool), 1).all()


def test_both_sides_of_a_large_relative_jump_are_edges():
    depth = np.array([[1.0, 1.0, 1.04, 1.06, 2.0, 0.0, 1.0]])

    # The jumps are 0, 4 %, 1.9 %, 89 %; an invalid pixel makes none.
    assert dut.depth_edges(depth, 0.03).tolist() == [[False, True, True, True, True, False, False]]
    assert dut.depth_edges(depth.T, 0.5).ravel().tolist() == [False] * 3 + [True] * 2 + [False] * 2


def test_clean_mask_keeps_reliable_depth_away_from_edges():
    depth = np.full((7, 12), 1.0, dtype=np.float32)
    depth[:, 6:] = 1.5
    depth[3, 1] = 0.0
    depth[3, 10] = 9.0
    mask = np.ones((7, 12), dtype=bool)
    mask[:, 0] = False
    config = dut.DepthMaskConfig(erosion=0, edge_margin=1, relative_jump=0.03, max_depth=3.0)

    cleaned = dut.clean_mask(mask, depth, config)

    assert cleaned[0].tolist() == [False] + [True] * 3 + [False] * 4 + [True] * 4
    assert not cleaned[3, 1]
    assert not cleaned[3, 10]
    # The far pixel is itself a jump, so its neighbours go too.
    assert not cleaned[3, 9]
    assert cleaned[3, 2]


def test_mask_of_another_size_is_rejected():
    with pytest.raises(InvalidValueError, match=r"\(2, 2\)"):
        dut.clean_mask(np.ones((2, 2), dtype=bool), np.ones((3, 3)), dut.DepthMaskConfig())
