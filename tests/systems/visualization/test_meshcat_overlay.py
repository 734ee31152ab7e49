import base64
import json
import math

import cv2
import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams, Rgba

from poil_drake.systems.visualization.meshcat_overlay import (
    CAMERA_PATH,
    FIELD_OF_VIEW,
    LINE_HEIGHT,
    OVERLAY_PATH,
    DrawRectangle,
    DrawText,
    MeshcatOverlay,
    text_width,
)

RED, BLACK = Rgba(1.0, 0.0, 0.0), Rgba(0.0, 0.0, 0.0)


@pytest.fixture
def dut(spy):
    return MeshcatOverlay(
        spy, phase_names=["move_to_grasp", "follow"], legend={"points": Rgba(1, 0, 0)}
    )


@pytest.mark.parametrize(("index", "known"), [(0, True), (1, True), (2, False), (-1, False)])
def test_a_phase_is_shown_if_it_has_a_name(spy, dut, index, known):
    dut.show_phase(index)

    assert spy.visible(f"{OVERLAY_PATH}/phase") == known


@pytest.mark.parametrize(
    ("error", "digits"),
    [
        (0.0, "  00"),
        (0.00004, "  00"),
        (0.0056, "  56"),
        (0.0123, " 123"),
        (0.34567, "3457"),
        (1e3, "9999"),
    ],
)
def test_an_error_is_shown_in_millimetres(spy, dut, error, digits):
    dut.show_error(error)

    assert spy.visible(f"{OVERLAY_PATH}/error")
    shown = [
        [d for d in range(10) if spy.visible(f"{OVERLAY_PATH}/error/place_{p}/{d}")]
        for p in range(4)
    ]
    assert shown == [[] if digit == " " else [int(digit)] for digit in digits]


@pytest.mark.parametrize("error", [math.nan, math.inf])
def test_a_non_finite_error_is_hidden(spy, dut, error):
    dut.show_error(0.0056)

    dut.show_error(error)

    assert not spy.visible(f"{OVERLAY_PATH}/error")


def test_everything_fits_into_the_height_of_the_screen(spy, dut):
    distance = -spy.poses[OVERLAY_PATH].translation()[2]
    half_screen = distance * math.tan(FIELD_OF_VIEW / 2.0)

    for line in ("phase", "error", "legend"):
        height = spy.poses[f"{OVERLAY_PATH}/{line}"].translation()[1]
        panel = json.loads(
            spy.objects[f"{OVERLAY_PATH}/{line}/panel"].source().in_memory().mesh_file.contents()
        )
        half_panel = panel["accessors"][0]["max"][2]
        assert 0.0 < half_panel < half_screen - abs(height)
    assert spy.properties[CAMERA_PATH, "fov"] == pytest.approx(math.degrees(FIELD_OF_VIEW))


def test_an_overlay_without_phases_is_possible():
    meshcat = Meshcat(MeshcatParams(host="localhost"))

    MeshcatOverlay(meshcat, phase_names=(), legend={"points": Rgba(1, 0, 0)})

    assert meshcat.HasPath(f"{OVERLAY_PATH}/error")


class Picture:
    """Replaces a Meshcat: decodes the picture that is drawn, and its rectangle."""

    def SetObject(self, path, mesh):
        gltf = json.loads(mesh.source().in_memory().mesh_file.contents())
        png, data = (
            base64.b64decode(entry["uri"].partition(",")[2])
            for entry in (*gltf["images"], *gltf["buffers"])
        )
        self.pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
        # Drake's loader turns y of glTF to z.
        self.corners = np.frombuffer(data, "<f4", 12).reshape(4, 3) @ [
            [1, 0, 0],
            [0, 0, 1],
            [0, -1, 0],
        ]

    @property
    def size(self):
        """Width and height [m] of a rectangle centred at the origin of the x-y plane."""
        np.testing.assert_allclose(self.corners.mean(axis=0), 0.0, atol=1e-9)
        np.testing.assert_allclose(self.corners[:, 2], 0.0)
        return np.ptp(self.corners, axis=0)[:2]


@pytest.fixture
def drawn():
    return Picture()


def test_text_advances_by_the_widths_of_its_characters():
    assert text_width("8m") == pytest.approx(text_width("8") + text_width("m"))
    assert text_width("8m", bold=True) > text_width("8m")


def test_all_digits_and_the_figure_space_have_the_same_width():
    assert {text_width(digit) for digit in "0123456789\u2007"} == {text_width("0")}


def test_the_picture_has_the_size_of_the_text(drawn):
    DrawText(drawn, "text", [("mm", BLACK)], size=0.1)

    assert drawn.size == pytest.approx([0.1 * text_width("mm"), 0.1 * LINE_HEIGHT])
    rows, columns, _ = drawn.pixels.shape
    assert columns / rows == pytest.approx(text_width("mm") / LINE_HEIGHT, rel=0.02)


def test_the_picture_shows_the_text_upright(drawn):
    DrawText(drawn, "text", [("L", BLACK)], size=0.1)

    ink = drawn.pixels[:, :, 3] > 128
    rows, columns = np.nonzero(ink)
    left, right = ink[:, : columns.max() // 2], ink[:, columns.max() // 2 + 1 :]
    assert left.sum() > 2 * right.sum()
    # The horizontal stroke is the lowest one.
    assert np.argmax(ink.sum(axis=1)) > 0.8 * rows.max()


def test_each_piece_has_its_colour(drawn):
    DrawText(drawn, "text", [("■", RED), ("■", BLACK)], size=0.1)

    middle = drawn.pixels.shape[1] // 2
    for half, bgra in (
        (drawn.pixels[:, :middle], [0, 0, 255, 255]),
        (drawn.pixels[:, middle:], [0, 0, 0, 255]),
    ):
        opaque = half[half[:, :, 3] == 255]
        assert len(opaque) > 100
        assert (opaque == bgra).all()


def test_a_rectangle_has_its_size_and_color(drawn):
    DrawRectangle(drawn, "panel", width=0.4, height=0.1, color=Rgba(1.0, 0.6, 0.2, 0.8))

    assert drawn.size == pytest.approx([0.4, 0.1])
    assert drawn.pixels.tolist() == [[[51, 153, 255, 204]]]
