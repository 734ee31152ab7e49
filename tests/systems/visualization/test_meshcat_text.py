import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Meshcat, MeshcatParams, Rgba

from poil_drake.errors import InvalidValueError
from poil_drake.systems.visualization.meshcat_text import (
    DrawText,
    NumberDisplay,
    TextChoice,
    make_text_mesh,
    trapezoids,
)

SQUARE = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0]])
HOLE = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])


@pytest.fixture(scope="module")
def meshcat():
    return Meshcat(MeshcatParams(host="localhost"))


class Spy:
    """Stands for a Meshcat: keeps the last value of each property."""

    def __init__(self):
        self.properties = {}

    def SetProperty(self, path, name, value, time=None):
        self.properties[path, name] = value

    def __getattr__(self, name):
        return lambda *args, **kwargs: None

    def visible(self, path):
        return self.properties[path, "visible"]


def shown_digits(spy, places):
    """Reads a display like a human: '.' for a place where nothing is visible."""
    text = ""
    for place in range(places):
        on = [d for d in range(10) if spy.visible(f"display/place_{place}/{d}")]
        assert len(on) <= 1
        text += str(on[0]) if on else "."
    return text


def area(corners):
    """Shoelace formula, per polygon."""
    x, y = corners[..., 0], corners[..., 1]
    return 0.5 * np.sum(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1), axis=-1)


def triangle_areas(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i], :2] for i in range(3))
    u, v = b - a, c - a
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def test_a_square_is_one_trapezoid():
    np.testing.assert_allclose(trapezoids([SQUARE]), [SQUARE])


def test_a_hole_is_left_out():
    pieces = trapezoids([SQUARE, HOLE])

    assert np.sum(area(pieces)) == pytest.approx(9.0 - 1.0)
    centres = pieces.mean(axis=1)
    assert not np.any(np.all(np.abs(centres - 1.5) < 0.5, axis=1))


def test_nothing_gives_nothing():
    assert trapezoids([]).shape == (0, 4, 2)


@given(st.lists(st.floats(0.2, 3.0), min_size=3, max_size=12))
def test_the_area_of_a_star_shaped_outline_is_kept(radii):
    angles = 2.0 * np.pi * np.arange(len(radii)) / len(radii)
    outline = np.array(radii)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])

    pieces = area(trapezoids([outline]))

    assert np.all(pieces >= -1e-9)
    assert np.sum(pieces) == pytest.approx(area(outline), rel=1e-6)


@pytest.mark.parametrize("character", "0348ωBag")
def test_a_glyph_has_the_area_of_its_outline(character):
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    font = FontProperties(family="DejaVu Sans")
    outlines = TextPath((0, 0), character, size=200.0, prop=font).to_polygons()
    # Holes run the other way round, so that their area counts negative.
    expected = abs(sum(area(np.asarray(outline)) for outline in outlines)) / 200.0**2

    areas = triangle_areas(make_text_mesh(character))

    assert np.all(areas >= -1e-12), "triangles face the reader"
    # The outlines' curves are flattened at different sizes.
    assert np.sum(areas) == pytest.approx(expected, rel=0.03)


def test_text_advances_by_the_widths_of_its_characters():
    both, first, second = (make_text_mesh(text) for text in ("8m", "8", "m"))

    assert both.width == pytest.approx(first.width + second.width)
    assert len(both.faces) == len(first.faces) + len(second.faces)
    assert both.vertices[:, 0].max() == pytest.approx(first.width + second.vertices[:, 0].max())


def test_blanks_have_a_width_but_no_triangles():
    mesh = make_text_mesh("  ")

    assert mesh.width > 0.4
    assert mesh.faces.shape == (0, 3)


def test_draw_text_puts_a_mesh_into_the_scene(meshcat):
    width = DrawText(meshcat, "/text", "mm", size=0.1, color=Rgba(1, 0, 0))

    assert meshcat.HasPath("/text")
    assert width == pytest.approx(0.1 * make_text_mesh("mm").width)


@pytest.mark.parametrize(
    ("index", "expected"), [(0, [1, 0]), (1, [0, 1]), (None, [0, 0]), (7, [0, 0])]
)
def test_one_text_of_a_choice_is_visible(index, expected):
    spy = Spy()
    dut = TextChoice(spy, "choice", ["a", "b"], size=0.1, color=Rgba(0, 0, 0))

    dut.show(index)

    assert [spy.visible(f"choice/{i}") for i in range(2)] == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "..00"),
        (0.04, "..00"),
        (7.25, "..72"),
        (12.3, ".123"),
        (345.67, "3457"),
        (-12.3, ".123"),
        (1e6, "9999"),
    ],
)
def test_a_display_shows_rounded_numbers_without_leading_zeros(value, expected):
    spy = Spy()
    dut = NumberDisplay(
        spy, "display", integer_places=3, decimal_places=1, size=0.1, color=Rgba(0, 0, 0)
    )

    dut.show(value)

    assert spy.visible("display")
    assert shown_digits(spy, 4) == expected


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_display_hides_what_is_no_number(value):
    spy = Spy()
    dut = NumberDisplay(
        spy, "display", integer_places=3, decimal_places=1, size=0.1, color=Rgba(0, 0, 0)
    )

    dut.show(value)

    assert not spy.visible("display")


def test_a_display_without_places_is_refused():
    with pytest.raises(InvalidValueError):
        NumberDisplay(Spy(), "x", integer_places=0, decimal_places=1, size=0.1, color=Rgba(0, 0, 0))
