"""Text in Meshcat: flat triangle meshes of glyph outlines, because Meshcat has no text object.

Meshes of text are shown and hidden through the property `visible`, which, unlike a change of the
object itself, is part of a recording. So a text that changes is a set of texts drawn beforehand.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform

from poil_drake.errors import InvalidValueError

_FONT_SIZE = 24.0  # [points] Outlines are flattened at this size: finer than the eye can tell.


@dataclass(frozen=True)
class TextMesh:
    """A text as triangles in the plane z = 0, left end of its baseline at the origin.

    Attributes:
        vertices: (P, 3) vertices, as multiples of the font's size.
        faces: (F, 3) int32 vertex indices.
        width: Advance width of the text, as a multiple of the font's size.
    """

    vertices: np.ndarray
    faces: np.ndarray
    width: float


def make_text_mesh(text: str, *, bold: bool = False) -> TextMesh:
    """Returns the triangles of `text` set in DejaVu Sans, the font that matplotlib ships."""
    vertices, faces = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int32)]
    left, count = 0.0, 0
    for character in text:
        glyph = _make_glyph_mesh(character, bold)
        vertices.append(glyph.vertices + np.array([left, 0.0, 0.0]))
        faces.append(glyph.faces + np.int32(count))
        left += glyph.width
        count += len(glyph.vertices)
    return TextMesh(np.concatenate(vertices), np.concatenate(faces), left)


@lru_cache(maxsize=512)
def _make_glyph_mesh(character: str, bold: bool) -> TextMesh:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath, TextToPath

    font = FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
    advance, _, _ = TextToPath().get_text_width_height_descent(character, font, ismath=False)
    outlines = []
    if not character.isspace():
        outlines = TextPath((0.0, 0.0), character, size=_FONT_SIZE, prop=font).to_polygons()
    corners = trapezoids([np.asarray(outline) / _FONT_SIZE for outline in outlines])
    points, index = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    vertices = np.column_stack([points, np.zeros(len(points))])
    faces = index.reshape(-1, 4)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3).astype(np.int32)
    vertices.flags.writeable = faces.flags.writeable = False
    return TextMesh(vertices, faces, advance / font.get_size_in_points())


def trapezoids(outlines: Sequence[np.ndarray]) -> np.ndarray:
    """Cuts the inside of closed outlines (even-odd rule) into trapezoids between horizontal lines.

    Args:
        outlines: Closed polygons, (P, 2) each; holes are outlines too.

    Returns:
        (M, 4, 2) corners, counter-clockwise from the lower left.
    """
    edges = [
        np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
        for outline in outlines
        if len(outline) > 2
    ]
    if not edges:
        return np.zeros((0, 4, 2))
    segments = np.concatenate(edges)
    segments = segments[segments[:, 0, 1] != segments[:, 1, 1]]
    upward = np.argsort(segments[:, :, 1], axis=1)
    segments = np.take_along_axis(segments, upward[:, :, None], axis=1)
    levels = np.unique(segments[:, :, 1])
    pieces = []
    for low, high in pairwise(levels):
        crossing = segments[(segments[:, 0, 1] <= low) & (segments[:, 1, 1] >= high)]
        start, end = crossing[:, 0], crossing[:, 1]
        slope = (end[:, 0] - start[:, 0]) / (end[:, 1] - start[:, 1])
        x_low = start[:, 0] + slope * (low - start[:, 1])
        x_high = start[:, 0] + slope * (high - start[:, 1])
        order = np.argsort(x_low + x_high, kind="stable")
        for left, right in zip(order[0::2], order[1::2], strict=False):
            pieces.append(
                [
                    (x_low[left], low),
                    (x_low[right], low),
                    (x_high[right], high),
                    (x_high[left], high),
                ]
            )
    return np.array(pieces).reshape(-1, 4, 2)


def DrawText(
    meshcat: Meshcat,
    path: str,
    text: str,
    *,
    size: float,
    color: Rgba,
    align: float = 0.0,
    bold: bool = False,
) -> float:
    """Draws `text` in the x-y plane of `path`, lit by nothing but itself.

    Args:
        meshcat: Where to draw.
        path: The Meshcat path of the new object.
        text: One line of text.
        size: Font size [m].
        color: Its colour, which no lamp of the scene changes.
        align: What fraction of the width lies left of the origin: 0 left, 0.5 centred, 1 right.
        bold: Whether to use the bold face.

    Returns:
        The text's width [m].
    """
    mesh = make_text_mesh(text, bold=bold)
    vertices = mesh.vertices * size - np.array([align * mesh.width * size, 0.0, 0.0])
    if len(mesh.faces):
        meshcat.SetTriangleMesh(
            path, np.asfortranarray(vertices.T), np.asfortranarray(mesh.faces.T), Rgba(0, 0, 0, 1)
        )
        MakeSelfLit(meshcat, path, color)
    return mesh.width * size


def MakeSelfLit(meshcat: Meshcat, path: str, color: Rgba) -> None:
    """Lets the object at `path`, drawn in black, shine in `color` whatever the lamps do."""
    for channel, value in (("r", color.r()), ("g", color.g()), ("b", color.b())):
        # The page takes emissive light in linear units, the colours of objects in sRGB.
        meshcat.SetProperty(f"{path}/<object>", f"material.emissive.{channel}", value**2.2)


class TextChoice:
    """One of several texts at a place, of which one or none is visible at a time."""

    def __init__(
        self,
        meshcat: Meshcat,
        path: str,
        texts: Sequence[str],
        *,
        size: float,
        color: Rgba,
        align: float = 0.0,
        bold: bool = False,
    ):
        """Draws all of `texts` at `path` and hides them. Arguments as in `DrawText`."""
        self._meshcat = meshcat
        self._paths = [f"{path}/{index}" for index in range(len(texts))]
        for text_path, text in zip(self._paths, texts, strict=True):
            DrawText(meshcat, text_path, text, size=size, color=color, align=align, bold=bold)
        self.show(None)

    def show(self, index: int | None, time: float | None = None) -> None:
        """Shows the text `index`, or none. All texts get a key, so any part can be replayed.

        Args:
            index: Which text; None or one that does not exist hides all.
            time: Time in the recording [s], or None.
        """
        for i, path in enumerate(self._paths):
            self._meshcat.SetProperty(path, "visible", i == index, time)


class NumberDisplay:
    """A number with a fixed count of places, like the display of a scale."""

    def __init__(
        self,
        meshcat: Meshcat,
        path: str,
        *,
        integer_places: int,
        decimal_places: int,
        size: float,
        color: Rgba,
    ):
        """Draws ten digits for each place, from the origin of `path` to the right.

        Args:
            meshcat: Where to draw.
            path: The Meshcat path below which the digits stand.
            integer_places: Places before the point; a larger number shows as all nines.
            decimal_places: Places after it.
            size: Font size [m].
            color: The digits' colour.
        """
        if integer_places < 1 or decimal_places < 0:
            raise InvalidValueError(
                f"A NumberDisplay of {integer_places} and {decimal_places} places is not possible.",
                remedy="Ask for at least one place before the point and none or more after it.",
            )
        self._meshcat, self._path = meshcat, path
        self._integer_places, self._decimal_places = integer_places, decimal_places
        digit_width = max(make_text_mesh(digit).width for digit in "0123456789") * size
        point_width = make_text_mesh(".").width * size
        self._places = []
        for place in range(integer_places + decimal_places):
            after_point = place >= integer_places
            left = place * digit_width + point_width * after_point
            place_path = f"{path}/place_{place}"
            meshcat.SetTransform(place_path, RigidTransform([left, 0.0, 0.0]))
            self._places.append(
                TextChoice(meshcat, place_path, "0123456789", size=size, color=color)
            )
        if decimal_places:
            DrawText(meshcat, f"{path}/point", ".", size=size, color=color)
            meshcat.SetTransform(
                f"{path}/point", RigidTransform([integer_places * digit_width, 0.0, 0.0])
            )
        self.width = digit_width * len(self._places) + point_width * bool(decimal_places)

    def show(self, value: float, time: float | None = None) -> None:
        """Shows |value| rounded to the display's places, without leading zeros.

        Args:
            value: The number; one that is not finite hides the display.
            time: Time in the recording [s], or None.
        """
        digits = self._digits(value)
        self._meshcat.SetProperty(self._path, "visible", digits is not None, time)
        for place, choice in enumerate(self._places):
            choice.show(None if digits is None else digits[place], time)

    def _digits(self, value: float) -> list[int | None] | None:
        if not math.isfinite(value):
            return None
        places = len(self._places)
        number = min(round(abs(value) * 10**self._decimal_places), 10**places - 1)
        text = str(number).zfill(self._decimal_places + 1).rjust(places)
        return [None if digit == " " else int(digit) for digit in text]
