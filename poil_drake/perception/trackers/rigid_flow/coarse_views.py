"""Doubles the resolution of coarse images, so that thin parts are as wide as in fine ones.

The tracker's methods look at neighbourhoods of some pixels. With coarse pixels, a handle would be
lost in them.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from poil_drake.geometry.depth_image import COARSE_PIXEL
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.trackers.rigid_flow.appearance_model import is_on_surface
from poil_drake.perception.trackers.rigid_flow.view_window import EDGE_JUMP, square_kernel


def is_coarse(camera: CameraModel, point_W: np.ndarray) -> bool:
    """Returns whether a camera's pixels are coarse at a point (3,) [m, world]."""
    return bool(np.linalg.norm(point_W - camera.X_WC[:3, 3]) > COARSE_PIXEL * camera.K[0, 0])


def doubled_mask(mask: np.ndarray) -> np.ndarray:
    """Returns a mask (H, W) in twice the resolution."""
    return mask.repeat(2, axis=0).repeat(2, axis=1)


def doubled(frame: MultiViewFrame, chosen: Sequence[bool]) -> MultiViewFrame:
    """Returns a frame with some of its views in twice the resolution, without labels.

    Args:
        frame: The views.
        chosen: For each view, whether to double its resolution.
    """
    if not any(chosen):
        return frame
    views = [
        _doubled(camera, image) if coarse else (camera, image)
        for camera, image, coarse in zip(frame.cameras, frame.images, chosen, strict=True)
    ]
    cameras, images = zip(*views, strict=True)
    return replace(frame, cameras=cameras, images=images)


def _doubled(camera: CameraModel, image: RgbdImage) -> tuple[CameraModel, RgbdImage]:
    """Returns a view in twice the resolution.

    Depth is interpolated within surfaces, not across edges. Flying pixels are removed, because
    their copies would support each other.
    """
    size = 2 * camera.width, 2 * camera.height
    K = camera.K * [[2.0], [2.0], [1.0]]
    K[:2, 2] += 0.5  # The centre of the first pixel lies between those of the new ones.
    v, u = np.indices(image.depth.shape).reshape(2, -1)
    firm = is_on_surface(image.depth, u, v).reshape(image.depth.shape)
    depth = np.where(firm, image.depth, np.float32(0.0))
    nearest, farthest = (f(depth, square_kernel(1)) for f in (cv2.erode, cv2.dilate))
    within = (nearest > 0.0) & (farthest < np.float32(1.0 + 2.0 * EDGE_JUMP) * nearest)
    smooth = cv2.resize(depth, size, interpolation=cv2.INTER_LINEAR)
    depth = np.where(doubled_mask(within), smooth, doubled_mask(depth))
    rgb = cv2.resize(image.rgb, size, interpolation=cv2.INTER_LINEAR)
    return CameraModel(camera.name, *size, K, camera.X_WC), RgbdImage(rgb, depth, image.stamp)
