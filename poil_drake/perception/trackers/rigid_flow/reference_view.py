"""What the cameras saw in the first frame, where the object's pose is known."""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.view_window import square_kernel

CLEARANCE = 0.008
"""Depths this far apart belong to different surfaces [m]; depth noise at 1 m is smaller."""

_BORDER = 2
"""Pixels this near to the object's mask may show either the object or the background [px]."""


@dataclass(frozen=True, eq=False)
class ReferenceView(SharedOnCopy):
    """One camera's view of the first frame.

    Attributes:
        camera: The camera.
        X_CO: (4, 4) pose of the object in the camera's frame, in the first frame.
        depth: (H, W) float32 [m], 0 where invalid.
        nearest: (H, W) float32 least depth of the 3 x 3 pixels around each pixel [m], infinite
            where all are invalid.
        mask: (H, W) bool, the object and its border.
        background_nearest: (H, W) float32 like `nearest`, but only of pixels outside `mask` [m].
        background_farthest: (H, W) float32 largest depth of the same pixels [m], 0 where none is
            valid.
    """

    camera: CameraModel
    X_CO: np.ndarray
    depth: np.ndarray
    nearest: np.ndarray
    mask: np.ndarray
    background_nearest: np.ndarray
    background_farthest: np.ndarray

    def sees_through(self, points_O: np.ndarray) -> np.ndarray:
        """Returns whether the camera saw through points (M, 3) [m, object]: (M,) bool."""
        z, nearest, _, _ = self._look_up(points_O, self.X_CO)
        return np.isfinite(nearest) & (z < nearest - CLEARANCE)

    def allows(self, points_O: np.ndarray, points_W: np.ndarray) -> np.ndarray:
        """Returns which points (M,) bool may belong to the object.

        Excludes points that the camera saw through and points on a surface beside the object. Such
        a surface may since have moved with the object or stayed in place.

        Args:
            points_O: (M, 3) in the object's frame [m].
            points_W: (M, 3) the same points now [m, world].
        """
        moved = self._is_background(points_O, self.X_CO)
        stayed = self._is_background(points_W, inverse(self.camera.X_WC))
        return ~(self.sees_through(points_O) | moved | stayed)

    def shows_background(
        self, camera: CameraModel, rows: slice, columns: slice, depth: np.ndarray
    ) -> np.ndarray:
        """Returns which pixels (h, w) bool still show the background of the first frame.

        Args:
            camera: The camera now. If it has moved, no background is known.
            rows: Rows of the pixels.
            columns: Columns of the pixels.
            depth: (h, w) depth measured at the pixels now [m].
        """
        if not np.array_equal(camera.X_WC, self.camera.X_WC):
            return np.zeros(depth.shape, dtype=bool)
        nearest = self.background_nearest[rows, columns] - np.float32(CLEARANCE)
        farthest = self.background_farthest[rows, columns] + np.float32(CLEARANCE)
        return (depth >= nearest) & (depth <= farthest)

    def _is_background(self, points: np.ndarray, X: np.ndarray) -> np.ndarray:
        z, _, depth, on_object = self._look_up(points, X)
        return (depth > 0.0) & (np.abs(z - depth) < CLEARANCE) & ~on_object

    def _look_up(self, points: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, ...]:
        """Looks up points (M, 3), which X (4, 4) takes to the camera's frame.

        Returns their z [m], and `nearest`, `depth` and `mask` at their pixels (0 if outside).
        """
        points_C = transform_points(X, points)
        z = points_C[:, 2]
        uv = (points_C @ self.camera.K.T)[:, :2] / np.maximum(z, 1e-3)[:, None]
        u, v = np.rint(uv).astype(np.intp).T
        height, width = self.depth.shape
        inside = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (z > 0.05)
        u, v = np.where(inside, u, 0), np.where(inside, v, 0)
        return (
            z,
            np.where(inside, self.nearest[v, u], 0.0),
            np.where(inside, self.depth[v, u], 0.0),
            inside & self.mask[v, u],
        )


def make_reference_views(
    frame: MultiViewFrame, masks: tuple[np.ndarray, ...], X_WO: np.ndarray
) -> tuple[ReferenceView, ...]:
    """Returns the views of the first frame.

    Args:
        frame: The first frame.
        masks: (H, W) bool for each view: where the object is.
        X_WO: (4, 4) pose of the object.
    """
    views = []
    for camera, image, mask in zip(frame.cameras, frame.images, masks, strict=True):
        bordered = cv2.dilate(mask.astype(np.uint8), square_kernel(_BORDER)).astype(bool)
        background = np.where(bordered, np.float32(0.0), image.depth)
        views.append(
            ReferenceView(
                camera=camera,
                X_CO=inverse(camera.X_WC) @ X_WO,
                depth=image.depth,
                nearest=_nearest(image.depth),
                mask=bordered,
                background_nearest=_nearest(background),
                background_farthest=cv2.dilate(background, square_kernel(1)),
            )
        )
    return tuple(views)


def _nearest(depth: np.ndarray) -> np.ndarray:
    return cv2.erode(np.where(depth > 0.0, depth, np.float32(np.inf)), square_kernel(1))
