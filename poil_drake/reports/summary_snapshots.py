"""The camera pictures of a summary picture."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from poil_drake.geometry.depth_image import project
from poil_drake.reports.summary_panels import COLORS
from poil_drake.systems.logging.snapshot_recorder import Snapshot


def common_view(snapshots: Sequence[Snapshot], *, margin: float = 0.12) -> np.ndarray:
    """Returns the part of the camera picture that contains the points of all snapshots.

    Args:
        snapshots: One or more pictures of one camera.
        margin: Margin around the points, as a share of the picture's width.

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
    share = min(np.max((high - low + 2.0 * margin * size[0]) / size), 1.0)
    half = 0.5 * share * size
    centre = np.clip(0.5 * (low + high), half, size - half) - 0.5
    (left, top), (right, bottom) = centre - half, centre + half
    return np.array([left, right, top, bottom])


def draw_snapshot(axes: Any, snapshot: Snapshot, *, view: np.ndarray, legend: bool) -> None:
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
