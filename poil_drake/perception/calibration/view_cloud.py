"""The cloud of one view: its table, and its correspondences with other clouds."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.depth_image import depth_edges, depth_normals, project, unproject
from poil_drake.geometry.rigid_transform import cross, transform_points
from poil_drake.perception.images import CameraModel, RgbdImage

BAND = 0.1
"""The table is looked for within this distance of its height first [m]."""

_REACH = 0.04  # Largest distance of corresponding points of two clouds [m].
_POINTS = 20_000  # Largest number of points of a view.
_NORMAL_STEP = 3  # [px]
_STEEPEST = np.deg2rad(20.0)  # Largest tilt of a plane that may be the table.
_PLANE_TRIALS = 300
_PLANE_NOISE = 0.006  # Distance of a point from its plane, as a fraction of its depth.
_FEWEST_SHARE = 0.03  # A table covers at least this fraction of a view.
_FEWEST = 300  # Fewest points of a table.
_OBJECT_HEIGHT = 0.015  # Points higher above the table belong to objects [m].
_SEEN_THROUGH = 0.3  # Largest share of an object's points that another camera may look through.
_LEAST_AGREEMENT = 0.8  # Least cosine between the normals of corresponding points.


@dataclass(frozen=True, eq=False)
class ViewCloud:
    """The points of one view.

    Attributes:
        name: The camera.
        K: (3, 3) its intrinsic matrix [px].
        X_WC: (4, 4) its pose.
        depth: (H, W) its depth image [m].
        camera_points: (P, 3) points [m, camera].
        camera_normals: (P, 3) unit normals, in the camera's frame.
    """

    name: str
    K: np.ndarray
    X_WC: np.ndarray
    depth: np.ndarray
    camera_points: np.ndarray
    camera_normals: np.ndarray

    @staticmethod
    def of(camera: CameraModel, image: RgbdImage) -> "ViewCloud":
        """Returns the points of an image, but for the edges of surfaces."""
        depth = image.depth
        normals = depth_normals(depth, camera.K, step=_NORMAL_STEP, smoothing=_NORMAL_STEP)
        usable = np.isfinite(normals).all(axis=2) & ~depth_edges(depth, 0.03)
        points, pixels = unproject(depth, camera.K, usable)
        step = len(points) // _POINTS + 1
        points, pixels = points[::step], pixels[::step]
        chosen = normals[pixels[:, 1], pixels[:, 0]].astype(float)
        return ViewCloud(camera.name, camera.K, camera.X_WC, depth, points, chosen)

    @cached_property
    def points(self) -> np.ndarray:
        """The points (P, 3) [m, world]."""
        return transform_points(self.X_WC, self.camera_points)

    @cached_property
    def normals(self) -> np.ndarray:
        """The normals (P, 3) in the world."""
        return self.camera_normals @ self.X_WC[:3, :3].T

    @cached_property
    def tree(self) -> cKDTree:
        """The index of `points`."""
        return cKDTree(self.points)


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane n . p = d in the world, n_z > 0, and which points (P,) bool of a cloud are on it."""

    normal: np.ndarray
    d: float
    on: np.ndarray

    def height(self, points: np.ndarray) -> np.ndarray:
        """Returns the plane's height [m] at the x and y of points (P, 3)."""
        return (self.d - points[:, :2] @ self.normal[:2]) / self.normal[2]


def find_table(cloud: ViewCloud, table_height: float) -> Plane | None:
    """Returns the largest plane near the table, or else the largest level plane anywhere."""
    near = np.abs(cloud.points[:, 2] - table_height) < BAND
    for candidates in (np.flatnonzero(near), np.arange(len(cloud.points))):
        if len(candidates) < max(_FEWEST_SHARE * len(cloud.points), _FEWEST):
            continue
        plane = _largest_plane(cloud, candidates)
        if plane is not None and plane.on.mean() >= _FEWEST_SHARE:
            return plane
    return None


def _largest_plane(cloud: ViewCloud, candidates: np.ndarray) -> Plane | None:
    rng = np.random.default_rng(0)
    noise = _PLANE_NOISE * cloud.camera_points[:, 2]
    few = candidates[:: len(candidates) // 3000 + 1]
    corners = cloud.points[rng.choice(few, size=(_PLANE_TRIALS, 3))]
    normals = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(lengths, 1e-12)[:, None]
    level = (np.abs(normals[:, 2]) > np.cos(_STEEPEST)) & (lengths > 1e-12)
    if not level.any():
        return None
    normals, corners = normals[level], corners[level]
    distances = np.abs(cloud.points[few] @ normals.T - np.vecdot(normals, corners[:, 0]))
    best = np.argmax((distances < noise[few, None]).sum(axis=0))
    normal, d = normals[best], float(normals[best] @ corners[best, 0])
    on = np.abs(cloud.points @ normal - d) < noise
    for _ in range(3):
        centre = cloud.points[on].mean(axis=0)
        normal = np.linalg.svd(cloud.points[on] - centre, full_matrices=False)[2][2]
        d = float(normal @ centre)
        on = np.abs(cloud.points @ normal - d) < noise
        if np.count_nonzero(on) < _FEWEST:
            return None
    sign = np.sign(normal[2])
    return Plane(sign * normal, sign * d, on)


def correspondences(
    first: ViewCloud, second: ViewCloud, table_height: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns corresponding points above the table.

    Returns:
        Points of the first cloud, points of the second, and the mean of their normals, (M, 3) each.
        With the mean normals, distances along them vanish between points of the same curved surface
        (Rusinkiewicz 2019).
    """
    high = np.flatnonzero(first.points[:, 2] > table_height + _OBJECT_HEIGHT)
    distances, nearest = second.tree.query(first.points[high], distance_upper_bound=_REACH)
    found = np.isfinite(distances)
    high, nearest = high[found], nearest[found]
    # Two sides of a thin object are close together, but face different ways.
    same = np.vecdot(first.normals[high], second.normals[nearest]) > _LEAST_AGREEMENT
    high, nearest = high[same], nearest[same]
    normals = first.normals[high] + second.normals[nearest]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return first.points[high], second.points[nearest], normals


def looks_through(first: ViewCloud, second: ViewCloud, table_height: float) -> bool:
    """Returns whether the first camera looks through what the second sees above the table."""
    high = second.points[second.points[:, 2] > table_height + _OBJECT_HEIGHT]
    pixels, z = project(high, first.K, first.X_WC)
    height, width = first.depth.shape
    inside = ((pixels > -0.5) & (pixels < [width - 0.5, height - 0.5])).all(axis=1)
    u, v = pixels[inside].round().astype(int).T
    measured = first.depth[v, u]
    through = np.count_nonzero(measured > z[inside] + _REACH)
    return bool(through > max(_SEEN_THROUGH * np.count_nonzero(measured), _FEWEST))
