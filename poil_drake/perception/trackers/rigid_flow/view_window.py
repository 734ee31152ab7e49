"""The part of a camera's images that surrounds the object, and the surface that it shows."""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.geometry.depth_image import depth_edges, depth_normals, project
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.pca_normals import pca_normals
from poil_drake.geometry.point_cloud import PointCloud, statistical_inliers, voxel_downsample
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.images import CameraModel, RgbdImage

EDGE_JUMP = 0.015
"""Neighbouring pixels whose depths differ by more than this fraction are at a depth edge, where the
depths of two surfaces mix. 0.015 is 1 cm at 0.65 m."""

_MARGIN = 24  # around the predicted object [px]: room for its motion and for contour searches
_MIN_SIDE = 24  # contours cannot be searched for in a smaller window [px]
_BLUR = 1.0  # standard deviation of the blur before image gradients are taken [px]

_SPACING = 0.003  # of the surface points [m]; two pixels at 0.65 m
_NEIGHBOURS, _DEVIATIONS = 12, 2.5  # of the outlier test that removes flying pixels
_NORMAL_STEP = 1  # [px]; wider differences leave no normals on a handle
_NORMAL_SMOOTHING = 2  # half width of the box over which normals are averaged [px]


@dataclass(frozen=True, eq=False)
class ViewWindow(SharedOnCopy):
    """A window of one view, prepared for alignment.

    Attributes:
        corner: (u, v) of the window's top left pixel in the image.
        depth: (h, w) float32 measured depth [m], 0 where invalid.
        surface: (h, w) float32, `depth` without the pixels at depth edges.
        rgb: (h, w, 3) uint8 colour.
        grey: (h, w, 3) float32: blurred grey level and its gradients along u and v.
        focal: (fx, fy) [px].
        centre: (cx, cy) in the window [px].
        X_CW: (4, 4) pose of the world in the camera.
    """

    corner: tuple[int, int]
    depth: np.ndarray
    surface: np.ndarray
    rgb: np.ndarray
    grey: np.ndarray
    focal: tuple[float, float]
    centre: tuple[float, float]
    X_CW: np.ndarray

    @property
    def K(self) -> np.ndarray:
        """(3, 3) intrinsic matrix of the window [px]."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def at(self, X_WO: np.ndarray) -> "PosedView":
        """Returns this window with the object at pose X_WO (4, 4)."""
        X_CO = self.X_CW @ X_WO
        R_CO, origin = X_CO[:3, :3], X_CO[:3, 3]
        return PosedView(self, R_CO, origin, -origin @ R_CO)

    def project(self, points_C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns window coordinates u and v [px] of points (..., 3) [m, camera]."""
        inverse_z = 1.0 / np.maximum(points_C[..., 2], 1e-3)
        u = self.focal[0] * points_C[..., 0] * inverse_z + self.centre[0]
        v = self.focal[1] * points_C[..., 1] * inverse_z + self.centre[1]
        return u, v

    def unproject(self, u: np.ndarray, v: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Returns the points (..., 3) [m, camera] at pixels of the window and depths z [m]."""
        x = (u - self.centre[0]) * (z / self.focal[0])
        y = (v - self.centre[1]) * (z / self.focal[1])
        return np.stack([x, y, z], axis=-1)


@dataclass(frozen=True, eq=False)
class PosedView:
    """A window of one view, with the object at a given pose.

    Attributes:
        window: The window of the view.
        R_CO: (3, 3) rotation of the object in the camera.
        origin: (3,) origin of the object's frame in the camera [m].
        eye: (3,) centre of the camera in the object's frame [m].
    """

    window: ViewWindow
    R_CO: np.ndarray
    origin: np.ndarray
    eye: np.ndarray

    def to_camera(self, points_O: np.ndarray) -> np.ndarray:
        """Transforms points (..., 3) from the object's frame to the camera's [m]."""
        return points_O @ self.R_CO.T + self.origin

    def to_object(self, points_C: np.ndarray) -> np.ndarray:
        """Transforms points (..., 3) from the camera's frame to the object's [m]."""
        return points_C @ self.R_CO + self.eye

    def project(self, points_O: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns window coordinates u and v [px] of points (..., 3) [m, object]."""
        return self.window.project(self.to_camera(points_O))

    def unproject(self, u: np.ndarray, v: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Returns the points (..., 3) [m, object] at pixels of the window and depths z [m]."""
        return self.to_object(self.window.unproject(u, v, z))

    def pixel_gradient(
        self, du: np.ndarray | float, dv: np.ndarray | float, points_O: np.ndarray
    ) -> np.ndarray:
        """Returns the gradient (..., 3) [px/m] of du u + dv v with respect to the points [m]."""
        x, y, z = np.moveaxis(self.to_camera(points_O), -1, 0)
        inverse_z = 1.0 / z
        gx = du * self.window.focal[0] * inverse_z
        gy = dv * self.window.focal[1] * inverse_z
        gz = -(gx * x + gy * y) * inverse_z
        return np.stack([gx, gy, gz], axis=-1) @ self.R_CO


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


def make_window(camera: CameraModel, image: RgbdImage, points_W: np.ndarray) -> ViewWindow | None:
    """Returns the window around points (P, 3) [m, world], or None if few pixels are in view."""
    uv, z = project(points_W, camera.K, camera.X_WC)
    uv = uv[z > 0.05]
    if len(uv) == 0:
        return None
    low, high = np.floor(uv.min(axis=0)) - _MARGIN, np.ceil(uv.max(axis=0)) + _MARGIN + 1
    u0, v0 = max(int(low[0]), 0), max(int(low[1]), 0)
    u1, v1 = min(int(high[0]), camera.width), min(int(high[1]), camera.height)
    if u1 - u0 < _MIN_SIDE or v1 - v0 < _MIN_SIDE:
        return None
    depth = image.depth[v0:v1, u0:u1]
    edges = depth_edges(depth, EDGE_JUMP)
    rgb = np.ascontiguousarray(image.rgb[v0:v1, u0:u1])
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    blurred = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _BLUR)
    # Scharr's kernel gives 32 for a unit slope.
    gu = cv2.Scharr(blurred, cv2.CV_32F, 1, 0, scale=1.0 / 32.0)
    gv = cv2.Scharr(blurred, cv2.CV_32F, 0, 1, scale=1.0 / 32.0)
    return ViewWindow(
        corner=(u0, v0),
        depth=depth,
        surface=np.where(edges, np.float32(0.0), depth),
        rgb=rgb,
        grey=cv2.merge([blurred, gu, gv]),
        focal=(float(camera.K[0, 0]), float(camera.K[1, 1])),
        centre=(float(camera.K[0, 2]) - u0, float(camera.K[1, 2]) - v0),
        X_CW=inverse(camera.X_WC),
    )


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


def unproject_to_world(
    camera: CameraModel, depth: np.ndarray, u: np.ndarray, v: np.ndarray
) -> np.ndarray:
    """Returns the points (M, 3) [m, world] at pixels (M,) of a depth image (H, W) [m]."""
    z = depth[v, u].astype(float)
    pixels = np.stack([u * z, v * z, z], axis=1)
    return transform_points(camera.X_WC, pixels @ np.linalg.inv(camera.K).T)


def square_kernel(radius: int) -> np.ndarray:
    """Returns a kernel for `cv2.dilate` and `cv2.erode` that reaches `radius` pixels."""
    return np.ones((2 * radius + 1, 2 * radius + 1), dtype=np.uint8)
