"""Text in front of the scene: the phase and the error at the top, a colour legend at the bottom.

The text moves with the page's camera, so it always faces the viewer, both on the live page and in a
recording.
"""

import math
from collections.abc import Mapping, Sequence

from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform

from poil_drake.systems.visualization.meshcat_text import (
    LINE_HEIGHT,
    DrawRectangle,
    DrawText,
    text_width,
)

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
