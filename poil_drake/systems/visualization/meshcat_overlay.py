"""Text in front of the scene: the phase and the error above, a colour legend below.

The text hangs on the page's camera, so it faces whoever looks, from wherever they look, in the live
page and in a recording alike.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform

from poil_drake.systems.visualization.meshcat_text import (
    DrawText,
    MakeSelfLit,
    NumberDisplay,
    TextChoice,
    make_text_mesh,
)

CAMERA_PATH = "/Cameras/default/rotated/<object>"
"""Where Meshcat's page keeps its camera; objects below it move with the viewer."""

FIELD_OF_VIEW = math.radians(45.0)
"""The page's vertical field of view [rad]. The default, 75 degrees, distorts a scene this small."""

# Text stands so close to the camera that nothing else comes between; the page's near plane is at
# 0.01 m.
_DISTANCE = 0.1  # [m]
_HALF_SCREEN = _DISTANCE * math.tan(FIELD_OF_VIEW / 2.0)  # [m]
_PANEL_MARGIN = 0.05 * _HALF_SCREEN  # [m] to the left and the right of text.
_PANEL_OFFSET = 0.0005  # [m] How far panels stand behind their text.

# Sizes and heights as fractions of half the screen's height; 0 is the middle, 1 the upper edge.
_PHASE_SIZE, _PHASE_HEIGHT = 0.085, 0.885
_ERROR_SIZE, _ERROR_HEIGHT = 0.060, 0.790
_LEGEND_SIZE, _LEGEND_HEIGHT = 0.046, -0.955
_TEXT_COLOR = Rgba(0.08, 0.08, 0.12, 1.0)
_PANEL_COLOR = Rgba(1.0, 1.0, 1.0, 0.8)


class MeshcatOverlay:
    """Phase, error and legend in front of a Meshcat scene."""

    def __init__(
        self,
        meshcat: Meshcat,
        *,
        phase_names: Sequence[str] = (),
        legend: Mapping[str, Rgba] | None = None,
        path: str = f"{CAMERA_PATH}/poil",
    ):
        """Draws everything that can be shown, and hides all of it but the legend.

        Sets the page's field of view, which text of a fixed size on the screen depends on.

        Args:
            meshcat: Where to draw.
            phase_names: The phases' names, in the order of their indices.
            legend: What is drawn in which colour; None or empty for no legend.
            path: The Meshcat path to draw below.
        """
        self._meshcat, self._path = meshcat, path
        meshcat.SetProperty(CAMERA_PATH, "fov", math.degrees(FIELD_OF_VIEW))
        meshcat.Delete(path)
        meshcat.SetTransform(path, RigidTransform([0.0, 0.0, -_DISTANCE]))
        names = [name.replace("_", " ") for name in phase_names]
        widths = [make_text_mesh(name, bold=True).width for name in names]
        width = max([_PHASE_SIZE * _HALF_SCREEN * width for width in widths], default=0.0)
        # Both lines get the same panel width, so that they look like one display.
        width = max(width, self._draw_error())
        self._draw_panel("error", width, _ERROR_SIZE * _HALF_SCREEN)
        self._draw_phases(names)
        self._draw_panel("phase", width, _PHASE_SIZE * _HALF_SCREEN)
        self._draw_legend(legend or {})
        self.show_phase(None)
        self.show_error(math.nan)

    def show_phase(self, index: int | None, time: float | None = None) -> None:
        """Shows the phase with that index at `time` in the recording [s]; None hides it."""
        known = index is not None and 0 <= index < self._phase_count
        self._meshcat.SetProperty(f"{self._path}/phase", "visible", known, time)
        self._phases.show(index, time)

    def show_error(self, mean_error: float, time: float | None = None) -> None:
        """Shows the mean point error [m] at `time` in the recording [s]; NaN hides it."""
        finite = math.isfinite(mean_error)
        self._meshcat.SetProperty(f"{self._path}/error", "visible", finite, time)
        self._error.show(mean_error * 1e3 if finite else math.nan, time)

    def _draw_phases(self, names: Sequence[str]) -> None:
        size = _PHASE_SIZE * _HALF_SCREEN
        self._place("phase", _PHASE_HEIGHT)
        self._phase_count = len(names)
        self._phases = TextChoice(
            self._meshcat,
            f"{self._path}/phase/name",
            names,
            size=size,
            color=_TEXT_COLOR,
            align=0.5,
            bold=True,
        )

    def _draw_error(self) -> float:
        """Draws the line of the error and returns its width [m]."""
        size = _ERROR_SIZE * _HALF_SCREEN
        self._place("error", _ERROR_HEIGHT)
        line, label, unit = f"{self._path}/error", "mean point error ", " mm"
        widths = [make_text_mesh(text).width * size for text in (label, unit)]
        self._error = NumberDisplay(
            self._meshcat,
            f"{line}/number",
            integer_places=3,
            decimal_places=1,
            size=size,
            color=_TEXT_COLOR,
        )
        total = widths[0] + self._error.width + widths[1]
        for name, text, left in (
            ("label", label, 0.0),
            ("unit", unit, widths[0] + self._error.width),
        ):
            DrawText(self._meshcat, f"{line}/{name}", text, size=size, color=_TEXT_COLOR)
            self._meshcat.SetTransform(
                f"{line}/{name}", RigidTransform([left - total / 2.0, 0.0, 0.0])
            )
        self._meshcat.SetTransform(
            f"{line}/number", RigidTransform([widths[0] - total / 2.0, 0.0, 0.0])
        )
        return total

    def _draw_legend(self, legend: Mapping[str, Rgba]) -> None:
        if not legend:
            return
        size = _LEGEND_SIZE * _HALF_SCREEN
        dot, gap = 0.7 * size, 1.0 * size
        self._place("legend", _LEGEND_HEIGHT)
        widths = [1.5 * dot + make_text_mesh(name).width * size for name in legend]
        total = sum(widths) + gap * (len(widths) - 1)
        left = -total / 2.0
        for index, (name, color) in enumerate(legend.items()):
            path = f"{self._path}/legend/{index}"
            self._meshcat.SetTransform(path, RigidTransform([left, 0.0, 0.0]))
            _draw_rectangle(self._meshcat, f"{path}/dot", (0.0, 0.0), (dot, dot), color)
            DrawText(self._meshcat, f"{path}/text", name, size=size, color=_TEXT_COLOR)
            self._meshcat.SetTransform(f"{path}/text", RigidTransform([1.5 * dot, 0.0, 0.0]))
            left += widths[index] + gap
        self._draw_panel("legend", total, size)

    def _place(self, line: str, height: float) -> None:
        self._meshcat.SetTransform(
            f"{self._path}/{line}", RigidTransform([0.0, height * _HALF_SCREEN, 0.0])
        )

    def _draw_panel(self, line: str, width: float, size: float) -> None:
        path = f"{self._path}/{line}/panel"
        half = width / 2.0 + _PANEL_MARGIN
        lower_left, upper_right = (-half, -0.4 * size), (half, 1.0 * size)
        _draw_rectangle(self._meshcat, path, lower_left, upper_right, _PANEL_COLOR)
        self._meshcat.SetTransform(path, RigidTransform([0.0, 0.0, -_PANEL_OFFSET]))


def _draw_rectangle(
    meshcat: Meshcat,
    path: str,
    lower_left: tuple[float, float],
    upper_right: tuple[float, float],
    color: Rgba,
) -> None:
    (x0, y0), (x1, y1) = lower_left, upper_right
    vertices = np.array([[x0, x1, x1, x0], [y0, y0, y1, y1], [0.0, 0.0, 0.0, 0.0]])
    faces = np.array([[0, 0], [1, 2], [2, 3]], dtype=np.int32)
    meshcat.SetTriangleMesh(
        path, np.asfortranarray(vertices), np.asfortranarray(faces), Rgba(0, 0, 0, color.a())
    )
    MakeSelfLit(meshcat, path, color)
