import numpy as np
import pytest
from capture_bench import CAMERA, SIZE, K

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import CaptureError, NoImageError
from poil_drake.perception.capture.checks import check_intrinsics, checked_image

RGB = np.full((*SIZE, 3), 9, np.uint8)
DEPTH = np.full(SIZE, 0.5, np.float32)


def test_depth_that_is_not_a_distance_becomes_zero() -> None:
    depth = DEPTH.copy()
    depth[0, :4] = [np.nan, np.inf, -np.inf, -0.1]

    dut = checked_image(RGB.copy(), depth, stamp=2.0, size=SIZE, source="It")

    np.testing.assert_array_equal(dut.depth[0, :4], 0.0)
    np.testing.assert_array_equal(dut.depth[1:], DEPTH[1:], strict=True)
    np.testing.assert_array_equal(dut.rgb, RGB, strict=True)
    assert dut.stamp == 2.0


def test_16_bit_depth_is_in_steps_and_the_largest_is_invalid() -> None:
    depth = np.full(SIZE, 3, np.uint16)
    depth[0, :2] = 0, 65535
    expected = np.full(SIZE, 1.5, np.float32)
    expected[0, :2] = 0.0

    dut = checked_image(RGB.copy(), depth, stamp=2.0, size=SIZE, source="It", depth_step=0.5)

    np.testing.assert_array_equal(dut.depth, expected, strict=True)


@pytest.mark.parametrize(
    ("rgb", "depth", "step", "words"),
    [
        (RGB[:-1], DEPTH, None, "colour of shape"),
        (RGB[..., :1], DEPTH, None, "colour of shape"),
        (RGB[..., 0], DEPTH, None, "colour of shape"),
        (RGB.astype(np.float32), DEPTH, None, "colour of shape .* type float32"),
        (RGB, DEPTH[:, :-1], None, "depth of shape"),
        (RGB, DEPTH.T, None, "depth of shape"),
        (RGB, DEPTH.astype(np.uint16), None, "depth of shape .* type uint16"),
        (RGB, DEPTH.astype(np.float64), None, "depth of shape .* type float64"),
        (RGB, DEPTH, 0.5, "depth of shape .* type float32"),
    ],
)
def test_another_size_or_type_is_rejected(
    rgb: np.ndarray, depth: np.ndarray, step: float | None, words: str
) -> None:
    with pytest.raises(NoImageError, match=f"It delivers {words}"):
        checked_image(rgb, depth, stamp=0.0, size=SIZE, source="It", depth_step=step)


def test_memory_that_the_camera_reuses_is_copied() -> None:
    memory_rgb, memory_depth = RGB.copy(), DEPTH.copy()

    dut = checked_image(memory_rgb[:], memory_depth[:], stamp=0.0, size=SIZE, source="It")
    memory_rgb[:], memory_depth[:] = 0, 0.0

    np.testing.assert_array_equal(dut.rgb, RGB)
    np.testing.assert_array_equal(dut.depth, DEPTH)


def test_an_array_that_owns_its_data_is_not_copied() -> None:
    rgb = RGB.copy()

    dut = checked_image(rgb, DEPTH.copy(), stamp=0.0, size=SIZE, source="It")

    assert dut.rgb is rgb
    assert not rgb.flags.writeable


def test_intrinsics_within_a_pixel_are_accepted() -> None:
    check_intrinsics(K + np.diag([0.9, -0.9, 0.0]), CAMERA, source="It")


@pytest.mark.parametrize(("row", "column"), [(0, 0), (1, 1), (0, 2), (1, 2)])
def test_an_error_names_intrinsics_that_differ(row: int, column: int) -> None:
    found = K.copy()
    found[row, column] += 1.25
    text = ", ".join(f"{found[index]:.2f}" for index in ((0, 0), (1, 1), (0, 2), (1, 2)))

    with pytest.raises(CaptureError) as said:
        check_intrinsics(found, CAMERA, source="It")

    assert f"It has fx, fy, cx, cy = {text} px" in str(said.value)
    assert "the scenario has 20.00, 20.00, 3.50, 2.50 px" in str(said.value)


def test_a_scenario_accepts_the_text_of_the_remedy() -> None:
    found = np.array([[600.25, 0.0, 321.5], [0.0, 601.5, 240.75], [0.0, 0.0, 1.0]])
    with pytest.raises(CaptureError) as said:
        check_intrinsics(found, CAMERA, source="It")

    text = said.value.remedy.split(": ", 1)[1]
    config = ChooseScenario(data=f"{{{text}}}").cameras["left"]

    core = config.MakeCameras()[0].core()
    np.testing.assert_allclose(core.intrinsics().intrinsic_matrix(), found)
