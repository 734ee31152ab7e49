"""One page that summarizes a run: camera pictures above, signals over time below."""

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
    draw_verdict,
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
    """Draws the picture, creates its folder if needed, and returns its path.

    Args:
        path: The file. Its suffix is the format, e.g. `.png` or `.pdf`.
        data: The contents.
    """
    import matplotlib as mpl
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
        _draw_header(figure, data, height)
        _draw_snapshots(figure, data, height, picture_height)
        _draw_panels(figure, panels, data, height)
        figure.savefig(path, dpi=_DPI)
    return path


def _panels(data: SummaryData) -> list:
    """Returns the functions that draw the panels. Unknown tracking errors get no panel."""
    known = np.isfinite(data.tracking_errors).any()
    return [
        draw_point_error,
        *([draw_tracking_error] if known else []),
        draw_potential,
        draw_progress,
        draw_joint_velocities,
    ]


def _picture_height(data: SummaryData) -> float:
    if not data.snapshots:
        return 0.0
    camera = data.snapshots[0].camera
    width = (_WIDTH - 2.0 * _SIDE) / len(data.snapshots)
    return width * camera.height / camera.width + _TIME_HEIGHT


def _draw_header(figure: Any, data: SummaryData, height: float) -> None:
    left, top = _SIDE / _WIDTH, 1.0 - 0.16 / height
    verdict = "SUCCESS" if data.success else "FAILURE"
    right = draw_verdict(figure, verdict, success=data.success, left=left, top=top) + 0.2 / _WIDTH
    figure.text(right, top, f"{data.title}: {data.reason}", fontsize=14, weight="bold", va="top")
    y = 1.0 - 0.52 / height
    figure.text(left, y, data.subtitle, fontsize=9.5, color=COLORS["muted"], va="top")


def _draw_snapshots(figure: Any, data: SummaryData, height: float, picture_height: float) -> None:
    if not data.snapshots:
        return
    view, cell = common_view(data.snapshots), (_WIDTH - 2.0 * _SIDE) / len(data.snapshots)
    bottom = height - _HEADER_HEIGHT - picture_height + _TIME_HEIGHT
    axes = figure.subplots(
        1,
        len(data.snapshots),
        squeeze=False,
        gridspec_kw={
            "left": (_SIDE + 0.03) / _WIDTH,
            "right": 1.0 - (_SIDE + 0.03) / _WIDTH,
            "bottom": bottom / height,
            "top": 1.0 - _HEADER_HEIGHT / height,
            "wspace": 0.06 / (cell - 0.06),
        },
    )[0]
    for index, snapshot in enumerate(data.snapshots):
        draw_snapshot(axes[index], snapshot, view=view, legend=index == 0)


def _draw_panels(figure: Any, panels: Sequence, data: SummaryData, height: float) -> None:
    left, right, bottom = _MARGINS
    top = bottom + len(panels) * (_PANEL_HEIGHT + _GAP) - _GAP
    axes = figure.subplots(
        len(panels),
        sharex=True,
        gridspec_kw={
            "left": left / _WIDTH,
            "right": 1.0 - right / _WIDTH,
            "bottom": bottom / height,
            "top": top / height,
            "hspace": _GAP / _PANEL_HEIGHT,
        },
    )
    end = max([*data.times[-1:], *data.tracking_times[-1:], *(p.end for p in data.phases)])
    for one, draw in zip(axes, panels, strict=True):
        one.set_xlim(0.0, end)
        draw_phase_bands(one, data.phases)
        draw(one, data)
    axes[-1].set_xlabel("time [s]")
    draw_phase_names(axes[0], data.phases)
