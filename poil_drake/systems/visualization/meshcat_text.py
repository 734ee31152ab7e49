"""Text in Meshcat, drawn as pictures on rectangles because Meshcat has no text objects.

A recording holds changes of properties, never new objects. To change a text, draw all its versions
in advance and make one of them visible at a time.
"""

import base64
import json
from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh, Meshcat, Rgba

LINE_HEIGHT = 1.4
"""Height of a line's picture, as a multiple of the font size."""

_DESCENT = 0.4  # Height of that picture below the baseline, as a multiple of the font size.
_RESOLUTION = 64  # [px] per font size; about the size of the text on a screen.
_FONT = "DejaVu Sans"  # matplotlib ships it.


@cache
def text_width(text: str, *, bold: bool = False) -> float:
    """Returns the width that `text` takes up in a line, as a multiple of the font size."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    font = FontProperties(family=_FONT, weight="bold" if bold else "normal")
    width, _, _ = TextToPath().get_text_width_height_descent(text, font, ismath=False)
    return width / font.get_size_in_points()


def DrawText(
    meshcat: Meshcat,
    path: str,
    pieces: Sequence[tuple[str, Rgba]],
    *,
    size: float,
    bold: bool = False,
) -> None:
    """Draws a line of text in the x-y plane of `path`, centred at its origin.

    Args:
        meshcat: Where to draw.
        path: The Meshcat path of the new object.
        pieces: (text, colour) of each piece of the line, from left to right. The lights of the
            scene do not change the colours.
        size: Font size [m].
        bold: Whether to use the bold face.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    widths = [text_width(text, bold=bold) for text, _ in pieces]
    # One inch of the figure corresponds to the font size, which is 72 points.
    figure = Figure(figsize=(sum(widths), LINE_HEIGHT), dpi=_RESOLUTION, facecolor="none")
    left = 0.0
    for (text, color), width in zip(pieces, widths, strict=True):
        figure.text(
            left / sum(widths),
            _DESCENT / LINE_HEIGHT,
            text,
            color=(color.r(), color.g(), color.b()),
            family=_FONT,
            fontsize=72.0,
            weight="bold" if bold else "normal",
        )
        left += width
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = np.array(canvas.buffer_rgba())
    # Transparent pixels are white, which the page would blend into the text when it scales it.
    picture[picture[:, :, 3] == 0] = 0
    _draw_picture(meshcat, path, picture, size * sum(widths), size * LINE_HEIGHT)


def DrawRectangle(meshcat: Meshcat, path: str, *, width: float, height: float, color: Rgba) -> None:
    """Draws a rectangle [m] in the x-y plane of `path`, centred at its origin.

    The lights of the scene do not change the colour.
    """
    pixel = np.round(255.0 * np.array([color.r(), color.g(), color.b(), color.a()]))
    _draw_picture(meshcat, path, pixel.astype(np.uint8).reshape(1, 1, 4), width, height)


def _draw_picture(
    meshcat: Meshcat, path: str, picture: np.ndarray, width: float, height: float
) -> None:
    """Draws a picture (H, W, 4), uint8 RGBA, on a rectangle [m] that the scene does not light."""
    png = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGBA2BGRA))[1].tobytes()
    x, y = width / 2.0, height / 2.0
    # In glTF, y is up. Drake rotates y to z, and so this x-z plane to the x-y plane.
    corners = [[-x, 0.0, y], [x, 0.0, y], [-x, 0.0, -y], [x, 0.0, -y]]
    texture = [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0], [1.0, 0.0]]
    data = np.array(corners, "<f4").tobytes() + np.array(texture, "<f4").tobytes()
    vertices = {"bufferView": 0, "componentType": 5126, "count": 4}
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0, "mode": 5}
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "alphaMode": "BLEND",
        "extensions": {"KHR_materials_unlit": {}},
    }
    gltf = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "textures": [{"source": 0}],
        "images": [{"uri": f"data:image/png;base64,{base64.b64encode(png).decode()}"}],
        "accessors": [
            {**vertices, "type": "VEC3", "min": corners[2], "max": corners[1]},
            {**vertices, "type": "VEC2", "byteOffset": 48},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        "buffers": [
            {
                "byteLength": len(data),
                "uri": f"data:application/octet-stream;base64,{base64.b64encode(data).decode()}",
            }
        ],
    }
    file = MemoryFile(json.dumps(gltf), ".gltf", path)
    meshcat.SetObject(path, Mesh(InMemoryMesh(mesh_file=file)))
