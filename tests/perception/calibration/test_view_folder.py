from pathlib import Path

import numpy as np
import pytest

from poil_drake.errors import CalibrationError
from poil_drake.perception.calibration.view_folder import (
    POSITIONS_FILE,
    View,
    load_views,
    save_view,
)
from poil_drake.perception.images import CameraModel

MODELS = [CameraModel(name, 8, 6, np.eye(3), np.eye(4)) for name in ("left_top", "right")]
Q = np.linspace(-1.0, 1.0, 7)


def image(value: int) -> np.ndarray:
    pixels = np.full((6, 8, 3), value, np.uint8)
    pixels[0, 0] = [255, 0, 7]  # Red, so that exchanged channels show.
    return pixels


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two views, the second without an image of `right`."""
    path = tmp_path / "views"
    save_view(path, View("00", {"left_top": image(10), "right": image(20)}, Q))
    save_view(path, View("01", {"left_top": image(30)}, -Q))
    return path


def test_views_are_loaded_as_they_were_saved(folder: Path) -> None:
    first, second = load_views(folder, MODELS, on_hand=True)

    assert (first.name, second.name) == ("00", "01")
    np.testing.assert_array_equal(first.images["left_top"], image(10))
    np.testing.assert_array_equal(first.images["right"], image(20))
    assert set(second.images) == {"left_top"}
    np.testing.assert_allclose([first.q, second.q], [Q, -Q], atol=1e-9)


def test_a_loose_board_needs_no_joint_positions(folder: Path) -> None:
    (folder / POSITIONS_FILE).unlink()

    assert [view.q for view in load_views(folder, MODELS, on_hand=False)] == [None, None]
    with pytest.raises(CalibrationError, match=r"There is no '.*joint_positions\.csv'.*--keep"):
        load_views(folder, MODELS, on_hand=True)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("view,panda_joint1\n00,0,1,2,3,4,5,6\n", "no row for view '01'"),
        ("00,1,2,3\n", "Line 1 of .* is not a view's name and 7 angles: 00,1,2,3"),
        ("00,1,2,3,4,5,6,nan\n", "is not a view's name and 7 angles"),
        ("00,1,2,3,4,5,6,a\n", "is not a view's name and 7 angles"),
        ("00,0,-45,0,-135,0,90,45\n", "is not .* 7 angles: .*,-135,.* in radians"),
    ],
)
def test_damaged_joint_positions_are_refused(folder: Path, text: str, problem: str) -> None:
    (folder / POSITIONS_FILE).write_text(text)

    with pytest.raises(CalibrationError, match=problem):
        load_views(folder, MODELS, on_hand=True)


def test_images_of_other_cameras_or_sizes_are_refused(folder: Path) -> None:
    other = CameraModel("top", 8, 6, np.eye(3), np.eye(4))
    large = CameraModel("right", 16, 12, np.eye(3), np.eye(4))

    with pytest.raises(CalibrationError, match=r"no images of top.*images: left_top, right"):
        load_views(folder, [other], on_hand=False)
    with pytest.raises(CalibrationError, match=r"has 8 x 6 pixels.*scenario has 16 x 12"):
        load_views(folder, [large], on_hand=False)


@pytest.mark.parametrize("content", [b"", b"not a picture"])
def test_a_damaged_image_is_refused(folder: Path, content: bytes) -> None:
    path = folder / "00_right.png"
    path.write_bytes(content)

    with pytest.raises(CalibrationError, match=r"00_right\.png' cannot be read"):
        load_views(folder, MODELS, on_hand=False)
