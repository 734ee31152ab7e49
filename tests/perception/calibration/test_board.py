import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rendered_boards import BOARD, board_poses, cameras, rendered

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.depth_image import project
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.calibration.board import CalibrationBoard


def test_corners_in_a_noisy_image_are_found_to_a_fraction_of_a_pixel() -> None:
    (model,) = cameras("left")
    X_WB = board_poses(1)[0]

    found = BOARD.detect(rendered(model, X_WB))

    assert found is not None
    corners, pixels = found
    truth, _ = project(transform_points(X_WB, BOARD.corners[corners]), model.K, model.X_WC)
    assert len(corners) == 24
    errors = np.linalg.norm(pixels - truth, axis=1)
    assert np.median(errors) < 0.1
    # A shift of half a pixel would be a wrong convention for the centres of pixels.
    np.testing.assert_allclose((pixels - truth).mean(axis=0), 0.0, atol=0.05)


def test_a_board_that_is_cut_off_or_absent_is_no_view() -> None:
    (model,) = cameras("left")
    image = rendered(model, board_poses(1)[0])
    _, pixels = BOARD.detect(image) or ((), np.zeros((0, 2)))
    column = int(np.sort(pixels[:, 0])[4])  # Five corners are left of it.

    cut = image.copy()
    cut[:, column + 1 :] = 128

    assert BOARD.detect(cut) is None
    assert BOARD.detect(np.full_like(image, 128)) is None


@pytest.mark.parametrize("square", [0.038, 0.0251])
def test_the_print_has_the_boards_size(tmp_path: Path, square: float) -> None:
    dut = CalibrationBoard(6, 8, square=square, dictionary="5X5_100")

    size = dut.save(tmp_path / "board.png")
    dut.save(tmp_path / "board.pdf")

    picture = Image.open(tmp_path / "board.png")
    dots_per_metre = float(picture.info["dpi"][0]) / 0.0254
    found = dut.detect(np.stack([np.array(picture.convert("L"))] * 3, axis=-1))
    assert found is not None
    edges = np.diff(found[1].reshape(7, 5, 2), axis=1)[..., 0] / dots_per_metre
    np.testing.assert_allclose(edges, square, rtol=2e-3)
    # A page of a PDF is measured in points, 72 to the inch.
    text = (tmp_path / "board.pdf").read_bytes().decode("latin1")
    (box,) = re.findall(r"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", text)
    np.testing.assert_allclose(np.array(box, float) / 72 * 0.0254, size, rtol=1e-4)
    np.testing.assert_allclose(size, [6 * square + 0.02, 8 * square + 0.02], atol=1e-4)


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ({"square": 38.0}, "squares of 38 m"),
        ({"marker": 0.04}, "markers of 0.04 m"),
        ({"rows": 2}, "7 x 2 squares of"),
        ({"dictionary": "9X9"}, "'9X9' is not known.*4X4_50"),
        ({"columns": 20, "rows": 14}, "needs 140 markers, but the dictionary 4X4_50 has 50"),
    ],
)
def test_an_impossible_board_is_refused(values: dict, problem: str) -> None:
    with pytest.raises(InvalidValueError, match=problem):
        CalibrationBoard(**values)


def test_a_board_is_written_as_pdf_or_png(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"\.pdf or \.png"):
        BOARD.save(tmp_path / "board.jpg")
