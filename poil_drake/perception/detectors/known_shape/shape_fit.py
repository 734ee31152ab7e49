"""How well a known shape, placed somewhere and stretched, fits what the views show."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import distance_transform_edt

from poil_drake.geometry.depth_image import project
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.perception.images import MultiViewFrame

_SPACING = 0.003  # of the grids [m], about that of the clouds
_MARGIN = 0.06  # by which the grids reach beyond the clouds [m]
_FREE_DEPTH = 0.006  # measured depth this far behind a point shows that the point is free [m]

_WIDTH = 0.009  # distance at which a point counts half [m]: noise, and differences in shape
_FAR = 0.01  # beyond the shape, points do not count [m]
_NEAR = 0.008  # within this distance of the cluster, a point is seen [m]
_UNSEEN_WEIGHT = 0.25  # cost of a point where no view shows anything, relative to a free place
_LEVERAGE_SHARE = 0.6  # share of the points that are chosen by leverage; the rest is even

_UPRIGHT_WEIGHT = 0.06  # cost of a shape upside down, because objects usually stand as they did
_SIZE_WEIGHT, _ASPECT_WEIGHT = 0.2, 0.5  # of squared logarithmic scales: their mean, the rest


@dataclass(frozen=True, eq=False)
class KnownShape(SharedOnCopy):
    """The shape of an object, and which part of it matters.

    Attributes:
        cloud: The object's surface, with normals [m, in any frame whose z axis is vertical when
            the object stands as usual].
        part: (P,) bool, which of its points belong to the functional part; at least one.
        guessed: (P,) bool, which of its points no view has shown.
    """

    cloud: PointCloud
    part: np.ndarray
    guessed: np.ndarray

    @cached_property
    def center(self) -> np.ndarray:
        """The centroid (3,) of the points that views have shown [m]."""
        return self.cloud.points[~self.guessed].mean(axis=0)

    @cached_property
    def axes(self) -> np.ndarray:
        """The principal axes of these points, columns of (3, 3)."""
        return np.linalg.eigh(np.cov(self.cloud.points[~self.guessed].T))[1]


@dataclass(frozen=True, eq=False)
class Placements:
    """K ways to place and stretch a shape: x -> R U diag(exp(s)) U^T (x - c) + t.

    U are the shape's axes and c is its centre.

    Attributes:
        R: (K, 3, 3) rotations.
        log_scales: (K, 3) logarithms s of the scales along the shape's axes.
        t: (K, 3) positions of the shape's centre [m, world].
    """

    R: np.ndarray
    log_scales: np.ndarray
    t: np.ndarray

    @classmethod
    def at_rest(cls, shape: KnownShape) -> "Placements":
        """Returns the one placement that leaves a shape as and where it is."""
        return cls(np.eye(3)[None], np.zeros((1, 3)), shape.center[None])

    def __len__(self) -> int:
        return len(self.t)

    def select(self, which: np.ndarray) -> "Placements":
        """Returns the placements with these indices."""
        return Placements(self.R[which], self.log_scales[which], self.t[which])

    def joined(self, other: "Placements") -> "Placements":
        """Returns these placements, followed by others."""
        pairs = ((getattr(self, n), getattr(other, n)) for n in ("R", "log_scales", "t"))
        return Placements(*(np.concatenate(pair) for pair in pairs))

    def matrices(self, shape: KnownShape) -> np.ndarray:
        """Returns the linear maps (K, 3, 3)."""
        return self.R @ (shape.axes * np.exp(self.log_scales)[:, None, :]) @ shape.axes.T

    def apply(self, shape: KnownShape, points: np.ndarray) -> np.ndarray:
        """Returns where points (n, 3) [m] of the shape are: (K, n, 3) [m, world]."""
        return (points - shape.center) @ np.swapaxes(self.matrices(shape), 1, 2) + self.t[:, None]


class ShapeFit:
    """The cost of placements of a shape in a cluster of points.

    It is the mean cost of the shape's points, which are where the cluster is (0), where no view
    sees (up to 1/4), or where a view sees through (up to 1), plus the mean cost of the cluster's
    points, which are on the shape (0) or off it (up to 1), plus priors. Of both clouds, points that
    determine the shape's pose count more than others, because a mug's handle has few.
    """

    def __init__(
        self,
        shape: KnownShape,
        frame: MultiViewFrame,
        cluster: PointCloud,
        *,
        table_height: float,
        count: int,
    ):
        """Constructs the cost.

        Args:
            shape: The shape.
            frame: The views.
            cluster: Points of an object, perhaps of several that touch, with normals [m, world].
            table_height: Height of the plane below which nothing can be [m, world].
            count: Number of points of each cloud that are compared.
        """
        self.shape = shape
        self._points = shape.cloud.points[_informative(shape.cloud, count, shape.guessed)]
        self._scene = cluster.points[_informative(cluster, count)]
        own = shape.cloud.points - shape.center
        self._radius = float(np.linalg.norm(own, axis=1).max())
        self._own_grid = _Grid.around(own)
        self._own_distance = self._own_grid.distances(own)
        self._grid = _Grid.around(cluster.points)
        self._distance = self._grid.distances(cluster.points)
        self._free_depth = self._grid.free_depth(frame, table_height)

    def cost(self, placed: Placements) -> np.ndarray:
        """Returns the costs (K,)."""
        residuals = self.residuals(placed)
        return np.einsum("kr,kr->k", residuals, residuals)

    def residuals(self, placed: Placements) -> np.ndarray:
        """Returns residuals (K, r), whose squares add up to the costs."""
        index = self._grid.index(placed.apply(self.shape, self._points))
        own = np.maximum(
            _saturated(self._free_depth[index]),
            np.sqrt(_UNSEEN_WEIGHT) * _saturated(self._distance[index]),
        )
        size = placed.log_scales.mean(axis=1, keepdims=True)
        arms = self._scene - placed.t[:, None]
        undone = arms @ np.swapaxes(np.linalg.inv(placed.matrices(self.shape)), 1, 2)
        distance = self._own_distance[self._own_grid.index(undone)] * np.exp(size)
        # Points far away belong to something that touches the object.
        reach = self._radius * np.exp(size) + _FAR
        near = np.einsum("kni,kni->kn", arms, arms) < reach**2
        scene = np.where(near, _saturated(distance), 0.0)
        scene /= np.sqrt(np.maximum(near.sum(axis=1, keepdims=True), 1))
        tilt = np.sqrt(np.maximum(0.5 * _UPRIGHT_WEIGHT * (1.0 - placed.R[:, 2:, 2]), 0.0))
        aspect = np.sqrt(_ASPECT_WEIGHT) * (placed.log_scales - size)
        own /= np.sqrt(len(self._points))
        return np.concatenate([own, scene, tilt, np.sqrt(_SIZE_WEIGHT) * size, aspect], axis=1)

    def support(self, points: np.ndarray) -> tuple[float, float]:
        """Returns which shares of points (n, 3) [m, world] are seen, and seen through."""
        index = self._grid.index(points)
        seen = self._distance[index] < _NEAR
        through = self._free_depth[index] > _NEAR
        return float(seen.mean()), float(through.mean())


@dataclass(frozen=True, eq=False)
class _Grid:
    """A grid of cells; `index` numbers them."""

    lower: np.ndarray
    size: np.ndarray

    @classmethod
    def around(cls, points: np.ndarray) -> "_Grid":
        lower = points.min(axis=0) - _MARGIN
        extent = points.max(axis=0) + _MARGIN - lower
        return cls(lower, np.ceil(extent / _SPACING).astype(int) + 1)

    def index(self, points: np.ndarray) -> np.ndarray:
        """Returns the cells (...) in or next to which points (..., 3) are."""
        cell = ((points - self.lower) * (1.0 / _SPACING) + 0.5).astype(np.int32)
        np.clip(cell, 0, self.size - 1, out=cell)
        return (cell[..., 0] * self.size[1] + cell[..., 1]) * self.size[2] + cell[..., 2]

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Returns the distance of each cell from the nearest of the points [m]."""
        empty = np.ones(self.size, dtype=bool)
        empty.ravel()[self.index(points)] = False
        return self._edt(empty)

    def free_depth(self, frame: MultiViewFrame, table_height: float) -> np.ndarray:
        """Returns how deep each cell lies below the table or in space that a view sees through."""
        cells = self.lower + np.indices(tuple(self.size)).reshape(3, -1).T * _SPACING
        free = cells[:, 2] < table_height - _SPACING
        for camera, image in zip(frame.cameras, frame.images, strict=True):
            uv, z = project(cells, camera.K, camera.X_WC)
            u, v = np.rint(np.where(z[:, None] > 0.0, uv, -1.0)).astype(int).T
            inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
            depth = np.where(inside, image.depth[v * inside, u * inside], 0.0)
            free |= depth > z + _FREE_DEPTH
        return self._edt(free.reshape(self.size))

    def _edt(self, inside: np.ndarray) -> np.ndarray:
        return distance_transform_edt(inside, sampling=_SPACING).astype(np.float32).ravel()


def _saturated(distance: np.ndarray) -> np.ndarray:
    """Returns residuals of which the square is d^2 / (d^2 + w^2), after Geman and McClure."""
    return distance / np.sqrt(distance * distance + np.float32(_WIDTH**2))


def _informative(cloud: PointCloud, count: int, guessed: np.ndarray | None = None) -> np.ndarray:
    """Returns indices of points, of which most determine the cloud's pose well.

    A point's leverage is its share of the information on the pose (cf. Gelfand et al. 2003,
    "Geometrically stable sampling for the ICP algorithm"). Guessed points have none.
    """
    assert cloud.normals is not None
    arms = cloud.points - cloud.points.mean(axis=0)
    arms /= np.sqrt(np.mean(np.sum(arms**2, axis=1)))
    J = np.concatenate([np.cross(arms, cloud.normals), cloud.normals], axis=1)
    if guessed is not None:
        J[guessed] = 0.0
    leverage = np.einsum("mi,mi->m", J @ np.linalg.pinv(J.T @ J), J)
    share = _LEVERAGE_SHARE * leverage / leverage.sum() + (1.0 - _LEVERAGE_SHARE) / len(J)
    # Systematic sampling: one point for each equal step of the cumulative shares.
    chosen = np.unique(np.searchsorted(np.cumsum(share), (np.arange(count) + 0.5) / count))
    return np.minimum(chosen, len(J) - 1)
