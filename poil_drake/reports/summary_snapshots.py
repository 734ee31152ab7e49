"""The camera pictures of a summary picture."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from poil_drake.geometry.unprojection import project
from poil_drake.reports.summary_panels import COLORS
from poil_drake.systems.logging.snapshot_recorder import Snapshot


def common_view(snapshots: Sequence[Snapshot], *, margin: float = 0.12) -> np.ndarray:
    """Returns the part of the picture to show of all snapshots: where the points get to.

    Args:
        snapshots: Pictures of one camera.
        margin: What is added on each side, as a share of the picture's width.

    Returns:
        Left, right, upper and lower edge [px], with the proportions of the picture; all of it if
        no point is in view.
    """
    if not snapshots:
        return np.zeros(4)
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
        view: The part of it to show, as `common_view` returns it.
        legend: Whether to say what the marks mean.
    """
    camera = snapshot.camera
    axes.imshow(snapshot.rgb, interpolation="antialiased")
    for name, points, marker in (
        ("target", snapshot.target_points, "+"),
        ("points", snapshot.points, "o"),
    ):
        known = points[np.isfinite(points).all(axis=1)]
        if len(known) == 0:
            continue
        uv, depth = project(known, camera.K, camera.X_WC)
        uv = uv[depth > 0.0]
        axes.plot(
            uv[:, 0],
            uv[:, 1],
            marker,
            color=COLORS[name],
            markersize=3.2 if marker == "o" else 5.0,
            markeredgewidth=0.5 if marker == "o" else 1.3,
            markeredgecolor="white" if marker == "o" else COLORS[name],
            label={"target": "target points", "points": "points"}[name],
        )
    axes.set_xlim(view[0], view[1])
    axes.set_ylim(view[3], view[2])
    axes.set_xticks([])
    axes.set_yticks([])
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
