"""The surface that one view shows of an object."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.depth_image import depth_normals
from poil_drake.geometry.pca_normals import pca_normals
from poil_drake.geometry.point_cloud import PointCloud, statistical_inliers, voxel_downsample
from poil_drake.perception.trackers.rigid_flow.view_window import EDGE_JUMP, ViewWindow

_SPACING = 0.003  # of the surface points [m]; two pixels at 0.65 m
_NEIGHBOURS, _DEVIATIONS = 12, 2.5  # of the outlier test that removes flying pixels
_NORMAL_STEP = 1  # [px]; wider differences leave no normals on a handle
_NORMAL_SMOOTHING = 2  # half width of the box over which normals are averaged [px]


@dataclass(frozen=True, eq=False)
class ViewSurface:
    """Surface points of one view, in the camera's frame.

    Attributes:
        points: (M, 3) points, one for each occupied voxel [m].
        normals: (M, 3) unit normals.
        colors: (M, 3) uint8 RGB.
        usable: (h, w) bool, the pixels from which the points were made.
        normal_image: (h, w, 3) normals, finite where usable.
    """

    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    usable: np.ndarray
    normal_image: np.ndarray


def view_normals(window: ViewWindow, mask: np.ndarray) -> np.ndarray:
    """Returns unit normals (h, w, 3) in the camera's frame within a mask (h, w) bool.

    They are computed from the mask's pixels only, and are NaN outside it and along its border.
    """
    return depth_normals(
        np.where(mask, window.surface, np.float32(0.0)),
        window.K,
        step=_NORMAL_STEP,
        smoothing=_NORMAL_SMOOTHING,
        relative_jump=EDGE_JUMP,
    )


def view_surface(window: ViewWindow, mask: np.ndarray) -> ViewSurface:
    """Returns the surface that a window shows within a mask (h, w) bool."""
    trusted = mask & (window.surface > 0.0)
    normals = view_normals(window, trusted)
    v, u = np.nonzero(trusted)
    points = window.unproject(u, v, window.surface[v, u].astype(float))
    missing = np.flatnonzero(~np.isfinite(normals[v, u, 0]))
    if missing.size and len(points) >= 3:
        # Along borders, and on parts a few pixels wide, central differences are not available.
        normals[v[missing], u[missing]] = pca_normals(points, missing)
    kept = np.isfinite(normals[v, u, 0])
    kept &= statistical_inliers(points, neighbours=_NEIGHBOURS, deviations=_DEVIATIONS)
    usable = np.zeros_like(trusted)
    usable[v[kept], u[kept]] = True
    cloud = voxel_downsample(
        PointCloud(
            points[kept], normals[v[kept], u[kept]].astype(float), window.rgb[v[kept], u[kept]]
        ),
        _SPACING,
    )
    assert cloud.normals is not None and cloud.colors is not None  # noqa: PT018
    return ViewSurface(cloud.points, cloud.normals, cloud.colors, usable, normals)
