"""Text in front of the scene: the phase and the error at the top, a colour legend at the bottom.

The text moves with the page's camera, so it always faces the viewer, both on the live page and in a
recording. Meshcat has no text objects, so the text is drawn as pictures on rectangles. A recording
holds changes of properties, never new objects. To change a text, draw all its versions in advance
and make one of them visible at a time.
"""

import base64
import json
import math
from collections.abc import Mapping, Sequence
from functools import cache

import cv2
import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh, Meshcat, Rgba
from pydrake.math import RigidTransform

CAMERA_PATH = "/Cameras/default/rotated/<object>"
"""Where Meshcat's page keeps its camera; objects below it move with the viewer."""

OVERLAY_PATH = f"{CAMERA_PATH}/poil"
"""The Meshcat path below which the overlay is drawn."""

FIELD_OF_VIEW = math.radians(45.0)
"""The page's vertical field of view [rad]. Meshcat's default, 75 degrees, distorts small scenes."""

# Text is so close to the camera that nothing can come between them; the page's near plane is at
# 0.01 m.
_DISTANCE = 0.1  # [m]
_HALF_SCREEN = _DISTANCE * math.tan(FIELD_OF_VIEW / 2.0)  # [m]
_PANEL_MARGIN = 0.05 * _HALF_SCREEN  # [m] to the left and the right of the text.
_PANEL_OFFSET = 0.0005  # [m] Distance of panels behind their text.

# Font sizes and heights as fractions of half the screen's height; 0 is the middle, 1 the top.
_PHASE_SIZE, _PHASE_HEIGHT = 0.085, 0.911
_ERROR_SIZE, _ERROR_HEIGHT = 0.060, 0.808
_LEGEND_SIZE, _LEGEND_HEIGHT = 0.046, -0.941
_TEXT_COLOR = Rgba(0.08, 0.08, 0.12, 1.0)
_PANEL_COLOR = Rgba(1.0, 1.0, 1.0, 0.8)

# The error is a display of four digits, drawn over spaces that are as wide as a digit.
_LABEL, _DIGIT_SPACE = "mean point error ", "\u2007"
_ERROR_LINE = f"{_LABEL}{3 * _DIGIT_SPACE}.{_DIGIT_SPACE} mm"

LINE_HEIGHT = 1.4
"""Height of a line's picture, as a multiple of the font size."""

_DESCENT = 0.4  # Height of that picture below the baseline, as a multiple of the font size.
_RESOLUTION = 64  # [px] per font size; about the size of the text on a screen.
_FONT = "DejaVu Sans"  # matplotlib ships it.


class MeshcatOverlay:
    """Phase, error and legend in front of a Meshcat scene."""

    def __init__(
        self,
        meshcat: Meshcat,
        *,
        phase_names: Sequence[str],
        legend: Mapping[str, Rgba],
    ):
        """Draws everything that can be shown, and hides all but the legend.

        Also sets the page's field of view, which determines the size of the text on the screen.

        Args:
            meshcat: Where to draw.
            phase_names: The phases' names, in the order of their indices.
            legend: Label -> colour, for each thing drawn.
        """
        self._meshcat, self._num_phases = meshcat, len(phase_names)
        meshcat.SetProperty(CAMERA_PATH, "fov", math.degrees(FIELD_OF_VIEW))
        meshcat.Delete(OVERLAY_PATH)
        meshcat.SetTransform(OVERLAY_PATH, RigidTransform([0.0, 0.0, -_DISTANCE]))
        names = [name.replace("_", " ") for name in phase_names]
        # Both lines get the same panel width, so that they look like one display.
        width = max(
            [_ERROR_SIZE * text_width(_ERROR_LINE)]
            + [_PHASE_SIZE * text_width(name, bold=True) for name in names]
        )
        self._place_line("phase", _PHASE_HEIGHT, _PHASE_SIZE, width)
        for index, name in enumerate(names):
            self._draw_text(f"phase/name/{index}", [(name, _TEXT_COLOR)], _PHASE_SIZE, bold=True)
        self._place_line("error", _ERROR_HEIGHT, _ERROR_SIZE, width)
        self._draw_text("error/line", [(_ERROR_LINE, _TEXT_COLOR)], _ERROR_SIZE)
        self._draw_digits()
        self._draw_legend(legend)
        self.show_phase(None)
        self.show_error(math.nan)

    def show_phase(self, index: int | None, time: float | None = None) -> None:
        """Shows the phase with this index at `time` in the recording [s].

        The phase is hidden if the index is None or has no name.
        """
        known = index is not None and 0 <= index < self._num_phases
        self._meshcat.SetProperty(f"{OVERLAY_PATH}/phase", "visible", known, time)
        self._show_one("phase/name", self._num_phases, index, time)

    def show_error(self, mean_error: float, time: float | None = None) -> None:
        """Shows the mean point error [m] at `time` in the recording [s].

        The text shows at most 999.9 mm. An error that is not finite hides the line.
        """
        finite = math.isfinite(mean_error)
        self._meshcat.SetProperty(f"{OVERLAY_PATH}/error", "visible", finite, time)
        shown = f"{min(1e3 * mean_error, 999.9):5.1f}" if finite else "   . "
        for place, digit in enumerate(shown.replace(".", "")):
            self._show_one(f"error/place_{place}", 10, None if digit == " " else int(digit), time)

    def _show_one(self, name: str, count: int, chosen: int | None, time: float | None) -> None:
        """Shows the text with the index `chosen` of `count` texts, if not None; hides the rest."""
        for index in range(count):
            self._meshcat.SetProperty(
                f"{OVERLAY_PATH}/{name}/{index}", "visible", index == chosen, time
            )

    def _draw_digits(self) -> None:
        """Draws all ten digits at each of the four places of the error."""
        left = text_width(_LABEL) - text_width(_ERROR_LINE) / 2.0
        for place, before in enumerate(("", "0", "00", "000.")):
            x = left + text_width(before) + text_width("0") / 2.0
            self._meshcat.SetTransform(
                f"{OVERLAY_PATH}/error/place_{place}",
                RigidTransform([x * _ERROR_SIZE * _HALF_SCREEN, 0.0, 0.0]),
            )
            for digit in range(10):
                self._draw_text(
                    f"error/place_{place}/{digit}", [(str(digit), _TEXT_COLOR)], _ERROR_SIZE
                )

    def _draw_legend(self, legend: Mapping[str, Rgba]) -> None:
        pieces: list[tuple[str, Rgba]] = []
        for name, color in legend.items():
            pieces += [("   ■" if pieces else "■", color), (f" {name}", _TEXT_COLOR)]
        width = _LEGEND_SIZE * sum(text_width(text) for text, _ in pieces)
        self._place_line("legend", _LEGEND_HEIGHT, _LEGEND_SIZE, width)
        self._draw_text("legend/line", pieces, _LEGEND_SIZE)

    def _place_line(self, name: str, height: float, size: float, width: float) -> None:
        """Moves a line to its height and draws its panel. The unit is half the screen's height."""
        path = f"{OVERLAY_PATH}/{name}"
        self._meshcat.SetTransform(path, RigidTransform([0.0, height * _HALF_SCREEN, 0.0]))
        DrawRectangle(
            self._meshcat,
            f"{path}/panel",
            width=width * _HALF_SCREEN + 2.0 * _PANEL_MARGIN,
            height=LINE_HEIGHT * size * _HALF_SCREEN,
            color=_PANEL_COLOR,
        )
        self._meshcat.SetTransform(f"{path}/panel", RigidTransform([0.0, 0.0, -_PANEL_OFFSET]))

    def _draw_text(
        self, name: str, pieces: Sequence[tuple[str, Rgba]], size: float, *, bold: bool = False
    ) -> None:
        DrawText(
            self._meshcat, f"{OVERLAY_PATH}/{name}", pieces, size=size * _HALF_SCREEN, bold=bold
        )


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
