"""Which points a view shows, and where a view's pixels are in the world."""

import numpy as np

from poil_drake.geometry.depth_image import project
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import CameraModel, RgbdImage

_RELATIVE_JUMP = 0.03  # largest spread of depth around a pixel of one surface, as a share of it
_MIN_VALID = 5  # of the 9 pixels around a point, which must have depth
_TOLERANCE = 0.01  # a visible point is this near to the measured surface [m]


def lift_pixels(uv: np.ndarray, camera: CameraModel, image: RgbdImage) -> np.ndarray:
    """Returns the points (N, 3) [m, world] on the surfaces that pixels show.

    A pixel's depth is the median of the 3 x 3 pixels around it. Where these miss depth or belong to
    several surfaces, the point is NaN, because depth at an edge lies between the surfaces.

    Args:
        uv: (N, 2) pixel coordinates, anywhere; NaN gives NaN.
        camera: The camera's model.
        image: The camera's image.
    """
    z = _depth_at(uv, image.depth)
    rays = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(camera.K).T
    return transform_points(camera.X_WC, z[:, None] * rays)


def visible(points: np.ndarray, camera: CameraModel, image: RgbdImage) -> np.ndarray:
    """Returns which points (N, 3) [m, world] lie on the surface that a view shows, (N,) bool."""
    uv, z = project(points, camera.K, camera.X_WC)
    return np.abs(_depth_at(uv, image.depth) - z) < _TOLERANCE


def _depth_at(uv: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Returns the depth (N,) [m] around pixels (N, 2); NaN where it is not reliable."""
    height, width = depth.shape
    inside = np.all((uv > -0.5) & (uv < [width - 0.5, height - 0.5]), axis=1)
    u, v = np.rint(np.where(inside[:, None], uv, 0.0)).astype(int).T
    step = np.arange(3)
    around = np.pad(depth, 1)[v[:, None, None] + step[:, None], u[:, None, None] + step]
    around = around.reshape(-1, 9).astype(float)
    valid = around > 0.0
    usable = inside & (np.count_nonzero(valid, axis=1) >= _MIN_VALID)
    z = np.full(len(uv), np.nan)
    if usable.any():
        known = np.where(valid, around, np.nan)[usable]
        median = np.nanmedian(known, axis=1)
        spread = np.nanmax(known, axis=1) - np.nanmin(known, axis=1)
        z[usable] = np.where(spread <= _RELATIVE_JUMP * median, median, np.nan)
    return z
