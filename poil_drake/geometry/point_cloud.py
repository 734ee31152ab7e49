"""Point clouds, their sampling and the detection of outliers."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields


@dataclass(frozen=True, eq=False)
class PointCloud(SharedOnCopy):
    """Points with optional normals and colours.

    Attributes:
        points: (P, 3) positions [m].
        normals: (P, 3) unit normals, or None.
        colors: (P, 3) uint8 RGB, or None.
    """

    points: np.ndarray
    normals: np.ndarray | None = None
    colors: np.ndarray | None = None

    def __post_init__(self) -> None:
        freeze_fields(self, points=("P", 3))
        if self.normals is not None:
            freeze_fields(self, normals=self.points.shape)
        if self.colors is not None:
            freeze_fields(self, dtype=np.uint8, colors=self.points.shape)

    def __len__(self) -> int:
        return len(self.points)

    def select(self, which: np.ndarray) -> "PointCloud":
        """Returns the points selected by a mask (P,) bool or indices (M,)."""
        return PointCloud(
            self.points[which],
            None if self.normals is None else self.normals[which],
            None if self.colors is None else self.colors[which],
        )


def voxel_downsample(cloud: PointCloud, voxel_size: float) -> PointCloud:
    """Returns a cloud with one point for each occupied voxel: the mean of the points in the voxel.

    Colours are averaged; normals are averaged and normalised. If the normals of a voxel cancel, as
    those of a thin wall's two faces do, the normal of the voxel's first point is used. The points
    are in the lexicographic order of their voxels.

    Args:
        cloud: The cloud to downsample.
        voxel_size: Edge of a voxel [m], positive.
    """
    if len(cloud) == 0:
        return cloud
    cells = np.floor(cloud.points / voxel_size).astype(np.int64)
    cells -= cells.min(axis=0)
    # One number per voxel, in lexicographic order, sorts ten times as fast as rows of three.
    numbers = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, first, inverse, counts = np.unique(
        numbers, return_index=True, return_inverse=True, return_counts=True
    )

    def mean(values: np.ndarray) -> np.ndarray:
        sums = [np.bincount(inverse, values[:, k], minlength=len(counts)) for k in range(3)]
        return np.stack(sums, axis=1) / counts[:, None]

    normals = None
    if cloud.normals is not None:
        normals = mean(cloud.normals)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.where(length > 1e-3, normals, cloud.normals[first])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    colors = None
    if cloud.colors is not None:
        colors = np.round(mean(cloud.colors)).astype(np.uint8)
    return PointCloud(mean(cloud.points), normals, colors)


def farthest_point_sampling(points: np.ndarray, count: int) -> np.ndarray:
    """Returns the indices (count,) of points that cover a cloud evenly.

    The first is the point farthest from the centroid; each later one is the point farthest from all
    those chosen before it. Ties go to the lowest index, so the result depends only on the points.

    Args:
        points: (P, 3) [m], finite.
        count: Number of points to choose, 1 to P.
    """
    indices = np.empty(count, dtype=np.intp)
    offsets = points - points.mean(axis=0)
    indices[0] = np.argmax(np.sum(offsets**2, axis=1))
    nearest = np.full(len(points), np.inf)
    for k in range(1, count):
        latest = points[indices[k - 1]]
        np.minimum(nearest, np.sum((points - latest) ** 2, axis=1), out=nearest)
        indices[k] = np.argmax(nearest)
    return indices


def statistical_inliers(points: np.ndarray, *, neighbours: int, deviations: float) -> np.ndarray:
    """Returns which points (P,) bool are not statistical outliers.

    A point is an outlier if its mean distance to its nearest neighbours is more than `deviations`
    standard deviations above the cloud's average of that distance.

    Args:
        points: (P, 3) [m].
        neighbours: Number of neighbours. A cloud of at most this many points has no outliers.
        deviations: Threshold [standard deviations].
    """
    if len(points) <= neighbours:
        return np.ones(len(points), dtype=bool)
    distances, _ = cKDTree(points).query(points, k=neighbours + 1)
    mean = distances[:, 1:].mean(axis=1)
    return mean <= mean.mean() + deviations * mean.std()
