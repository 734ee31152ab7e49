"""Draws a demonstration as one picture, its contact sheet."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.recording.demonstration.demonstration import Demonstration

_TITLE_KEYS = ("scenario", "object", "fixture", "seed")
"""The metadata that the title shows."""

_COLUMNS = 8  # Frames shown, evenly spaced from the first to the last.
_TILE_WIDTH = 240  # [px] of one image.
_GAP = 4  # [px] between images.

_DPI = 100
"""Dots per inch, which sets the size of the text relative to the images."""

_DEPTH_PERCENTILES = (2.0, 98.0)
"""Percentiles of depth at the ends of the colour scale; a few far pixels do not stretch it."""


def contact_sheet(demonstration: Demonstration, path: str | Path) -> None:
    """Writes a PNG of frames in order of time. Each camera has a row of colour and one of depth.

    Args:
        demonstration: The demonstration. Only the frames shown are decoded.
        path: The file, whose name ends in .png; its folder is created if needed.

    Raises:
        InvalidValueError: if the name does not end in .png.
    """
    from matplotlib.figure import Figure

    if Path(path).suffix != ".png":
        raise InvalidValueError(
            f"The picture's path '{path}' does not end in .png.", remedy="Use the suffix .png."
        )
    count = len(demonstration.frames)
    indices = np.rint(np.linspace(0, count - 1, min(_COLUMNS, count))).astype(int).tolist()
    views = [demonstration.frames[i].images for i in indices]
    rows = len(demonstration.cameras)
    colors = [_strip([images[row].rgb for images in views]) for row in range(rows)]
    depths = [_strip([images[row].depth for images in views]) for row in range(rows)]
    height, width = colors[0].shape[:2]
    figure = Figure(
        figsize=(width / _DPI + 1.3, 2 * rows * height / _DPI + 1.0),
        dpi=_DPI,
        layout="constrained",
    )
    axes = figure.subplots(2 * rows, 1, squeeze=False)[:, 0]
    for row, camera in enumerate(demonstration.cameras):
        axes[2 * row].imshow(colors[row])
        axes[2 * row].set_ylabel(camera.name)
        axes[2 * row + 1].set_ylabel(f"{camera.name}, depth")
        _draw_depth(figure, axes[2 * row + 1], depths[row])
    for axis in axes:
        axis.set(xticks=[], yticks=[])
        axis.spines[:].set_visible(False)
    stamps = demonstration.stamps[indices] - demonstration.stamps[0]
    centres = (np.arange(len(indices)) + 0.5) * (_TILE_WIDTH + _GAP) - _GAP / 2
    axes[0].set_xticks(centres, [f"{stamp:.2f} s" for stamp in stamps])
    axes[0].tick_params(labeltop=True, labelbottom=False, length=0)
    figure.suptitle(_title(demonstration), fontsize=11)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="png")


def _draw_depth(figure: Any, axis: Any, depth: np.ndarray) -> None:
    """Draws a depth image [m] in colours beside a colour bar; invalid pixels are grey."""
    from matplotlib import colormaps

    seen = np.ma.masked_equal(depth, 0.0)
    valid = seen.compressed()
    low, high = np.percentile(valid, _DEPTH_PERCENTILES) if valid.size else (0.0, 1.0)
    palette = colormaps["viridis_r"].with_extremes(bad="lightgrey")
    drawn = axis.imshow(seen, cmap=palette, vmin=low, vmax=high, interpolation="nearest")
    figure.colorbar(drawn, ax=axis, fraction=0.03, pad=0.005, label="depth [m]")


def _strip(images: Sequence[np.ndarray]) -> np.ndarray:
    """Returns images side by side, each `_TILE_WIDTH` wide. Gaps are white, or 0 in depth."""
    height = round(_TILE_WIDTH * images[0].shape[0] / images[0].shape[1])
    is_color = images[0].ndim == 3
    gap = np.full((height, _GAP, *images[0].shape[2:]), 255 if is_color else 0)
    tiles: list[np.ndarray] = []
    for image in images:
        size = (_TILE_WIDTH, height)
        # Averaged depth would show surfaces between an object and its background.
        filter_ = cv2.INTER_AREA if is_color else cv2.INTER_NEAREST
        tiles += [gap.astype(image.dtype), cv2.resize(image, size, interpolation=filter_)]
    return np.concatenate(tiles[1:], axis=1)


def _title(demonstration: Demonstration) -> str:
    metadata = demonstration.metadata
    size = f"{len(demonstration.frames)} frames in {demonstration.duration:.2f} s"
    about = [f"{key} {metadata[key]}" for key in _TITLE_KEYS if metadata.get(key)]
    return ", ".join([Path(demonstration.name).name, size, *about])
