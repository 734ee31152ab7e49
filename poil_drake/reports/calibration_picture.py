"""Draws the corners of a calibration board and their reprojection errors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from poil_drake.geometry.depth_image import project
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.camera_poses import CalibrationResult
from poil_drake.perception.calibration.first_guess import BoardView
from poil_drake.perception.calibration.view_folder import View
from poil_drake.perception.images import CameraModel

_SHOWN = 4  # Images of each camera: the one with the largest error, and others.
_MAGNIFICATION = 50.0  # of the errors in the images.


def calibration_picture(
    path: Path,
    cameras: Sequence[CameraModel],
    views: Sequence[View],
    found: Sequence[BoardView],
    board: CalibrationBoard,
    result: CalibrationResult,
) -> None:
    """Writes a PNG with a row of images for each camera, and the errors of its pose.

    Detected corners are circles; the computed poses put them at the crosses. Lines show the errors,
    magnified. Images that were left out are marked.

    Args:
        path: The file; its folder is created if needed.
        cameras: The calibrated cameras.
        views: The views.
        found: The corners in their images.
        board: The board.
        result: The computed poses.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2 * _SHOWN, 3.4 * len(cameras)), dpi=100, layout="constrained")
    rows = figure.subplots(len(cameras), _SHOWN, squeeze=False)
    for axes, camera in zip(rows, cameras, strict=True):
        own = [view for view in found if view.camera == camera.name]
        pixels = [_reprojected(view, camera, board, result) for view in own]
        sizes = [
            float(np.sqrt(((view.pixels - there) ** 2).sum(axis=1).mean()))
            for view, there in zip(own, pixels, strict=True)
        ]
        worst = int(np.argmax(sizes))
        others = [k for k in range(len(own)) if k != worst]
        spread = np.linspace(0, len(others) - 1, _SHOWN - 1).round().astype(int)
        shown = [worst, *(others[k] for k in spread)]
        for axis, k in zip(axes, shown, strict=False):
            view, there = own[k], pixels[k]
            axis.imshow(views[view.view].images[camera.name])
            ends = view.pixels + _MAGNIFICATION * (view.pixels - there)
            axis.plot(*np.stack([view.pixels, ends]).transpose(2, 0, 1), "-", color="red", lw=0.8)
            axis.plot(*view.pixels.T, "o", mfc="none", mec="lime", ms=5, mew=0.8)
            axis.plot(*there.T, "+", color="orange", ms=5, mew=0.8)
            out = ", left out" if view in result.left_out else ""
            axis.set_title(f"view {views[view.view].name}: {sizes[k]:.2f} px{out}", fontsize=9)
            axis.set(xticks=[], yticks=[], xlim=(0, camera.width), ylim=(camera.height, 0))
        calibrated = result.cameras[camera.name]
        axes[0].set_ylabel(f"{camera.name}: {calibrated.rms:.2f} px\n{calibrated.error_text}")
    figure.suptitle(
        f"Board {board.columns} x {board.rows}; circles: detected corners, crosses: "
        f"computed; red: errors x {_MAGNIFICATION:g}",
        fontsize=10,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="png")


def _reprojected(
    view: BoardView, camera: CameraModel, board: CalibrationBoard, result: CalibrationResult
) -> np.ndarray:
    """Returns the pixels (K, 2) at which the computed poses put a view's corners."""
    points = transform_points(result.boards[view.view], board.corners[view.corners])
    return project(points, camera.K, result.cameras[camera.name].X_WC)[0]
