"""One page that shows how a run went: pictures above, figures over time below."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.reports.summary_data import SummaryData
from poil_drake.reports.summary_panels import (
    COLORS,
    STYLE,
    draw_joint_velocities,
    draw_phase_bands,
    draw_phase_names,
    draw_point_error,
    draw_potential,
    draw_progress,
    draw_tracking_error,
)
from poil_drake.reports.summary_snapshots import common_view, draw_snapshot

_WIDTH = 12.0  # [in]
_DPI = 150
_PANEL_HEIGHT = 1.35  # [in]
_HEADER_HEIGHT = 0.75  # [in]
_SIDE = 0.3  # [in] left and right of the header and the pictures.
_TIME_HEIGHT = 0.25  # [in] below the pictures, for their times.
_PHASES_HEIGHT = 0.75  # [in] between the pictures and the first panel, for the phases' names.
_MARGINS = (0.85, 0.95, 0.55)  # [in] left, right, bottom.
_GAP = 0.14  # [in] between panels.


def make_summary_picture(path: str | Path, data: SummaryData) -> Path:
    """Draws the picture and returns its path; the folder is made where needed.

    Args:
        path: Where it goes; the suffix is the format, e.g. `.png` or `.pdf`.
        data: What it shows.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    panels = _panels(data)
    picture_height = _picture_height(data)
    height = (
        _HEADER_HEIGHT
        + picture_height
        + _PHASES_HEIGHT
        + len(panels) * (_PANEL_HEIGHT + _GAP)
        + _MARGINS[2]
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(_WIDTH, height))
        FigureCanvasAgg(figure)
        _draw_header(figure, data, height)
        _draw_snapshots(figure, data, height, picture_height)
        _draw_panels(figure, panels, data, height)
        figure.savefig(path, dpi=_DPI)
    return path


def _panels(data: SummaryData) -> list:
    """Returns the functions that draw the panels for which there is anything to draw."""
    panels = [draw_point_error, draw_potential, draw_progress, draw_joint_velocities]
    if len(data.times) == 0:
        panels = []
    if np.isfinite(data.tracking_errors).any():
        panels.insert(1 if panels else 0, draw_tracking_error)
    return panels


def _picture_height(data: SummaryData) -> float:
    if not data.snapshots:
        return 0.0
    camera = data.snapshots[0].camera
    width = (_WIDTH - 2.0 * _SIDE) / len(data.snapshots)
    return width * camera.height / camera.width + _TIME_HEIGHT


def _draw_header(figure: Any, data: SummaryData, height: float) -> None:
    color = COLORS["success"] if data.success else COLORS["failure"]
    verdict = "SUCCESS" if data.success else "FAILURE"
    left, top = _SIDE / _WIDTH, 1.0 - 0.16 / height
    title = figure.text(
        left,
        top,
        f" {verdict} ",
        fontsize=14,
        weight="bold",
        color="white",
        va="top",
        bbox={"facecolor": color, "edgecolor": "none", "boxstyle": "round,pad=0.25"},
    )
    figure.canvas.draw()
    right = title.get_window_extent().x1 / figure.bbox.width + 0.2 / _WIDTH
    figure.text(right, top, f"{data.title}: {data.reason}", fontsize=14, weight="bold", va="top")
    if data.subtitle:
        y = 1.0 - 0.52 / height
        figure.text(left, y, data.subtitle, fontsize=9.5, color=COLORS["muted"], va="top")


def _draw_snapshots(figure: Any, data: SummaryData, height: float, picture_height: float) -> None:
    view = common_view(data.snapshots)
    for index, snapshot in enumerate(data.snapshots):
        cell = (_WIDTH - 2.0 * _SIDE) / len(data.snapshots)
        bottom = height - _HEADER_HEIGHT - picture_height + _TIME_HEIGHT
        axes = figure.add_axes(
            (
                (_SIDE + index * cell + 0.03) / _WIDTH,
                bottom / height,
                (cell - 0.06) / _WIDTH,
                (picture_height - _TIME_HEIGHT) / height,
            )
        )
        draw_snapshot(axes, snapshot, view=view, legend=index == 0)


def _draw_panels(figure: Any, panels: Sequence, data: SummaryData, height: float) -> None:
    left, right, bottom = _MARGINS
    end = max(
        [*data.times[-1:], *data.tracking_times[-1:], *(p.end for p in data.phases)], default=1
    )
    first = None
    for index, draw in enumerate(panels):
        row = len(panels) - 1 - index
        axes = figure.add_axes(
            (
                left / _WIDTH,
                (bottom + row * (_PANEL_HEIGHT + _GAP)) / height,
                (_WIDTH - left - right) / _WIDTH,
                _PANEL_HEIGHT / height,
            ),
            sharex=first,
        )
        first = first or axes
        axes.set_xlim(0.0, end)
        draw_phase_bands(axes, data.phases)
        draw(axes, data)
        axes.tick_params(labelbottom=row == 0)
        if row == 0:
            axes.set_xlabel("time [s]")
    if first is not None:
        draw_phase_names(first, data.phases)
