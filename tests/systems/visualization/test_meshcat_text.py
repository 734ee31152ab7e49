import base64
import json

import cv2
import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams, Rgba

from poil_drake.systems.visualization.meshcat_text import (
    LINE_HEIGHT,
    DrawRectangle,
    DrawText,
    text_width,
)

RED, BLACK = Rgba(1.0, 0.0, 0.0), Rgba(0.0, 0.0, 0.0)


class Spy:
    """A fake Meshcat: decodes the picture that is drawn, and its rectangle."""

    def SetObject(self, path, mesh):
        gltf = json.loads(mesh.source().in_memory().mesh_file.contents())
        png, data = (
            base64.b64decode(entry["uri"].partition(",")[2])
            for entry in (*gltf["images"], *gltf["buffers"])
        )
        self.picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
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
def spy():
    return Spy()


def test_text_advances_by_the_widths_of_its_characters():
    assert text_width("8m") == pytest.approx(text_width("8") + text_width("m"))
    assert text_width("8m", bold=True) > text_width("8m")


def test_all_digits_and_the_figure_space_have_the_same_width():
    assert {text_width(digit) for digit in "0123456789\u2007"} == {text_width("0")}


def test_the_picture_has_the_size_of_the_text(spy):
    DrawText(spy, "text", [("mm", BLACK)], size=0.1)

    assert spy.size == pytest.approx([0.1 * text_width("mm"), 0.1 * LINE_HEIGHT])
    rows, columns, _ = spy.picture.shape
    assert columns / rows == pytest.approx(text_width("mm") / LINE_HEIGHT, rel=0.02)


def test_the_picture_shows_the_text_upright(spy):
    DrawText(spy, "text", [("L", BLACK)], size=0.1)

    ink = spy.picture[:, :, 3] > 128
    rows, columns = np.nonzero(ink)
    left, right = ink[:, : columns.max() // 2], ink[:, columns.max() // 2 + 1 :]
    assert left.sum() > 2 * right.sum()
    # The horizontal stroke is the lowest one.
    assert np.argmax(ink.sum(axis=1)) > 0.8 * rows.max()


def test_each_piece_has_its_colour(spy):
    DrawText(spy, "text", [("■", RED), ("■", BLACK)], size=0.1)

    middle = spy.picture.shape[1] // 2
    for half, bgra in (
        (spy.picture[:, :middle], [0, 0, 255, 255]),
        (spy.picture[:, middle:], [0, 0, 0, 255]),
    ):
        opaque = half[half[:, :, 3] == 255]
        assert len(opaque) > 100
        assert (opaque == bgra).all()


def test_a_rectangle_has_its_size_and_color(spy):
    DrawRectangle(spy, "panel", width=0.4, height=0.1, color=Rgba(1.0, 0.6, 0.2, 0.8))

    assert spy.size == pytest.approx([0.4, 0.1])
    assert spy.picture.tolist() == [[[51, 153, 255, 204]]]


def test_meshcat_takes_the_picture():
    meshcat = Meshcat(MeshcatParams(host="localhost"))

    DrawText(meshcat, "/text", [("mm", RED)], size=0.1)

    assert meshcat.HasPath("/text")
