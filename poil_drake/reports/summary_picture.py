"""One page that summarizes a run: camera pictures above, signals over time below."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.geometry.depth_image import project
from poil_drake.reports.summary_panels import (
    COLORS,
    SummaryData,
    draw_joint_velocities,
    draw_phases,
    draw_point_error,
    draw_potential,
    draw_progress,
    draw_tracking_error,
    draw_verdict,
    styled_figure,
)
from poil_drake.systems.logging.snapshot_recorder import Snapshot

_WIDTH = 12.0  # [in]
_PANEL_HEIGHT = 1.35  # [in]
_HEADER_HEIGHT = 0.75  # [in]
_SIDE = 0.3  # [in] left and right of the header and the pictures.
_TIME_HEIGHT = 0.25  # [in] below the pictures, for their times.
_PHASES_HEIGHT = 0.75  # [in] between the pictures and the first panel, for the phases' names.
_MARGINS = (0.85, 0.95, 0.55)  # [in] left, right, bottom.
_GAP = 0.14  # [in] between panels.
_VIEW_MARGIN = 0.12  # Around the points in a picture, as a share of the picture's width.


def make_summary_picture(path: str | Path, data: SummaryData) -> None:
    """Draws the picture of a run; the path's suffix is the format, e.g. `.png` or `.pdf`."""
    panels = [draw_point_error, draw_potential, draw_progress, draw_joint_velocities]
    if np.isfinite(data.tracking_errors).any():
        panels.insert(1, draw_tracking_error)
    picture_height = _picture_height(data)
    height = (
        _HEADER_HEIGHT
        + picture_height
        + _PHASES_HEIGHT
        + len(panels) * (_PANEL_HEIGHT + _GAP)
        + _MARGINS[2]
    )
    with styled_figure(path, (_WIDTH, height)) as figure:
        _draw_header(figure, data, height)
        _draw_snapshots(figure, data, height, picture_height)
        _draw_panels(figure, panels, data, height)


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
        _draw_snapshot(axes[index], snapshot, view=view, legend=index == 0)


def common_view(snapshots: Sequence[Snapshot]) -> np.ndarray:
    """Returns the part of the camera picture that contains the points of all snapshots.

    Args:
        snapshots: One or more pictures of one camera.

    Returns:
        (4,) left, right, upper and lower edge [px]. The part has the proportions of the picture,
        and is the whole picture if no point is in view.
    """
    camera = snapshots[0].camera
    size = np.array([camera.width, camera.height], dtype=float)
    points = np.concatenate([snapshot.points for snapshot in snapshots])
    uv, _ = project(points[np.isfinite(points).all(axis=1)], camera.K, camera.X_WC)
    uv = uv[np.all((uv >= 0.0) & (uv < size), axis=1)]
    if len(uv) == 0:
        return np.array([-0.5, size[0] - 0.5, -0.5, size[1] - 0.5])
    low, high = uv.min(axis=0), uv.max(axis=0)
    share = min(np.max((high - low + 2.0 * _VIEW_MARGIN * size[0]) / size), 1.0)
    half = 0.5 * share * size
    centre = np.clip(0.5 * (low + high), half, size - half) - 0.5
    (left, top), (right, bottom) = centre - half, centre + half
    return np.array([left, right, top, bottom])


def _draw_snapshot(axes: Any, snapshot: Snapshot, *, view: np.ndarray, legend: bool) -> None:
    """Draws a camera picture with the points and their targets in it, and its time below.

    Args:
        axes: Where to draw.
        snapshot: The picture.
        view: The part of the picture to show, from `common_view` [px].
        legend: Whether to draw a legend.
    """
    camera = snapshot.camera
    axes.imshow(snapshot.rgb, interpolation="antialiased")
    target = {"marker": "+", "markersize": 5.0, "markeredgewidth": 1.3, "label": "target points"}
    point = {"marker": "o", "markersize": 3.2, "markeredgewidth": 0.5, "label": "points"}
    for points, color, edge, style in (
        (snapshot.target_points, COLORS["target"], COLORS["target"], target),
        (snapshot.points, COLORS["points"], "white", point),
    ):
        known = points[np.isfinite(points).all(axis=1)]
        if len(known) == 0:
            continue
        uv, depth = project(known, camera.K, camera.X_WC)
        uv = uv[depth > 0.0]
        axes.plot(*uv.T, linestyle="", color=color, markeredgecolor=edge, **style)
    axes.set(xlim=view[:2], ylim=view[:1:-1], xticks=[], yticks=[])
    axes.grid(False)
    axes.set_xlabel(f"{snapshot.time:.1f} s", labelpad=2)
    if legend and axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="upper left",
            fontsize=6.5,
            frameon=True,
            framealpha=0.85,
            edgecolor="none",
            handletextpad=0.2,
            borderpad=0.3,
        )


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
    draw_phases(axes, data.phases, end)
    for one, draw in zip(axes, panels, strict=True):
        draw(one, data)
    axes[-1].set_xlabel("time [s]")
