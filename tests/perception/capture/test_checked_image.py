import numpy as np
import pytest
from capture_bench import SIZE

from poil_drake.errors import NoImageError
from poil_drake.perception.capture.checked_image import checked_image

RGB = np.full((*SIZE, 3), 9, np.uint8)
DEPTH = np.full(SIZE, 0.5, np.float32)


def test_depth_that_is_not_a_distance_becomes_invalid() -> None:
    depth = DEPTH.copy()
    depth[0, :4] = [np.nan, np.inf, -np.inf, -0.1]

    dut = checked_image(RGB.copy(), depth, stamp=2.0, size=SIZE, source="It")

    np.testing.assert_array_equal(dut.depth[0, :4], 0.0)
    np.testing.assert_array_equal(dut.depth[1:], DEPTH[1:], strict=True)
    np.testing.assert_array_equal(dut.rgb, RGB, strict=True)
    assert dut.stamp == 2.0


def test_16_bit_depth_is_counted_in_steps_and_the_largest_is_invalid() -> None:
    depth = np.full(SIZE, 3, np.uint16)
    depth[0, :2] = 0, 65535
    expected = np.full(SIZE, 1.5, np.float32)
    expected[0, :2] = 0.0

    dut = checked_image(RGB.copy(), depth, stamp=2.0, size=SIZE, source="It", depth_step=0.5)

    np.testing.assert_array_equal(dut.depth, expected, strict=True)


def test_16_bit_depth_is_wanted_where_a_step_is_given() -> None:
    with pytest.raises(NoImageError, match=r"depth of shape .* type float32"):
        checked_image(RGB, DEPTH, stamp=2.0, size=SIZE, source="It", depth_step=0.5)


@pytest.mark.parametrize(
    ("rgb", "depth", "words"),
    [
        (RGB[:-1], DEPTH, "colour of shape"),
        (RGB[..., :1], DEPTH, "colour of shape"),
        (RGB[..., 0], DEPTH, "colour of shape"),
        (RGB.astype(np.float32), DEPTH, "colour of shape .* type float32"),
        (RGB, DEPTH[:, :-1], "depth of shape"),
        (RGB, DEPTH.T, "depth of shape"),
        (RGB, DEPTH.astype(np.uint16), "depth of shape .* type uint16"),
        (RGB, DEPTH.astype(np.float64), "depth of shape .* type float64"),
    ],
)
def test_another_size_or_type_is_refused(rgb: np.ndarray, depth: np.ndarray, words: str) -> None:
    with pytest.raises(NoImageError, match=f"It delivers {words}"):
        checked_image(rgb, depth, stamp=0.0, size=SIZE, source="It")


def test_memory_that_the_camera_uses_again_is_copied() -> None:
    memory_rgb, memory_depth = RGB.copy(), DEPTH.copy()

    dut = checked_image(memory_rgb[:], memory_depth[:], stamp=0.0, size=SIZE, source="It")
    memory_rgb[:], memory_depth[:] = 0, 0.0

    np.testing.assert_array_equal(dut.rgb, RGB)
    np.testing.assert_array_equal(dut.depth, DEPTH)


def test_an_array_of_its_own_is_taken_over_without_a_copy() -> None:
    rgb = RGB.copy()

    dut = checked_image(rgb, DEPTH.copy(), stamp=0.0, size=SIZE, source="It")

    assert dut.rgb is rgb
    assert not rgb.flags.writeable
