"""The surface that one view shows of an object."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.pca_normals import pca_normals
from poil_drake.geometry.point_cloud import PointCloud, statistical_inliers, voxel_downsample
from poil_drake.geometry.unprojection import depth_normals
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow

_NEIGHBOURS, _DEVIATIONS = 12, 2.5  # what tells flying pixels from surface
_NORMAL_STEP = 1  # wider differences would leave no normals on a handle


@dataclass(frozen=True, eq=False)
class ViewSurface:
    """Surface points of one view, in the camera's frame.

    Attributes:
        points: (M, 3) at the model's spacing [m].
        normals: (M, 3) unit.
        colors: (M, 3) uint8 RGB.
        usable: (h, w) bool, the pixels that they were made from.
        normal_image: (h, w, 3) normals, finite where usable.
    """

    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    usable: np.ndarray
    normal_image: np.ndarray


def view_normals(window: ViewWindow, mask: np.ndarray, config: RigidFlowConfig) -> np.ndarray:
    """Returns normals (h, w, 3) in the camera's frame, from the pixels of a mask (h, w) only.

    They are NaN outside of the mask and along its border.
    """
    return depth_normals(
        np.where(mask, window.surface, np.float32(0.0)),
        window.K,
        step=_NORMAL_STEP,
        smoothing=config.model.normal_smoothing,
        relative_jump=config.window.edge_jump,
    )


def view_surface(window: ViewWindow, mask: np.ndarray, config: RigidFlowConfig) -> ViewSurface:
    """Takes the surface that a window shows within a mask.

    Args:
        window: The view.
        mask: (h, w) bool, pixels of the window that may be used.
        config: Parameters.
    """
    trusted = mask & (window.surface > 0.0)
    normals = view_normals(window, trusted, config)
    v, u = np.nonzero(trusted)
    points = window.unproject(u, v, window.surface[v, u].astype(float))
    missing = np.flatnonzero(~np.isfinite(normals[v, u, 0]))
    if missing.size and len(points) >= 3:
        # Along borders and on parts a few pixels wide there are no central differences.
        normals[v[missing], u[missing]] = pca_normals(points, viewpoint=np.zeros(3), at=missing)
    kept = np.isfinite(normals[v, u, 0])
    kept &= statistical_inliers(points, neighbours=_NEIGHBOURS, deviations=_DEVIATIONS)
    usable = np.zeros_like(trusted)
    usable[v[kept], u[kept]] = True
    cloud = voxel_downsample(
        PointCloud(
            points[kept], normals[v[kept], u[kept]].astype(float), window.rgb[v[kept], u[kept]]
        ),
        config.model.voxel_size,
    )
    assert cloud.normals is not None and cloud.colors is not None  # noqa: PT018 (as given)
    return ViewSurface(cloud.points, cloud.normals, cloud.colors, usable, normals)
