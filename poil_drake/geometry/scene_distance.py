"""Distance to a scene known as surface points and a ground plane, fast far away from it."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import frozen_array


@dataclass(frozen=True, kw_only=True)
class SceneDistanceConfig:
    """How a scene is indexed.

    Attributes:
        ground_height: Height of the table in the world [m], a plane, because cameras see only part
            of it; None where there is none.
        ground_thickness: Scene points less than this above the table belong to the table [m];
            about a depth camera's noise.
        voxel_size: Edge of the grid that says where a look at the points is needed [m]. Half of it
            decides less, twice as much makes eight times fewer voxels to fill.
        max_voxels: A grid of more takes a larger edge, 27 at least. A million fill in some 0.2 s.
        border: How far the grid reaches beyond the points [m]: the farthest `reach` that is free
            of any look at the points outside the grid.
    """

    ground_height: float | None = None
    ground_thickness: float = 0.004
    voxel_size: float = 0.008
    max_voxels: int = 500_000
    border: float = 0.05

    def __post_init__(self) -> None:
        if not (self.voxel_size > 0.0 and self.max_voxels >= 27 and self.border > 0.0):
            raise InvalidValueError(
                f"SceneDistanceConfig has voxel_size={self.voxel_size} m, "
                f"max_voxels={self.max_voxels} and border={self.border} m.",
                remedy="All must be positive, and max_voxels 27 at least.",
            )


class SceneDistance:
    """Obstacle points and a ground plane, ready for distance queries.

    Distances are to the points, exact to rounding. The surface that the points were sampled from
    may be nearer; see `measured`. A grid of lower bounds answers for whatever is farther from the
    points than anyone asks; a KD-tree answers for the rest.

    Attributes:
        points: (P, 3) obstacle points [m, world] without those of the ground.
        ground_height: Height of the ground [m]; None where there is none.
        spacing: Typical distance between neighbouring points [m]; 0 with fewer than two.
    """

    def __init__(self, points: np.ndarray, *, config: SceneDistanceConfig | None = None):
        """Indexes the points.

        Args:
            points: (P, 3) surface points of everything that must not be touched [m, world].
            config: Where the ground is and how fine the grid.
        """
        config = config or SceneDistanceConfig()
        self.ground_height = config.ground_height
        points = frozen_array(points, name="SceneDistance.points", shape=("P", 3))
        if self.ground_height is not None:
            points = points[points[:, 2] > self.ground_height + config.ground_thickness]
        self.points = frozen_array(points, name="SceneDistance.points", shape=("P", 3))
        self.spacing = 0.0
        self._tree: cKDTree | None = None
        if len(self.points):
            self._tree = cKDTree(self.points)
            self._fill_grid(config)
            if len(self.points) > 1:
                some = self.points[:: max(len(self.points) // 2000, 1)]
                self.spacing = float(np.median(self._tree.query(some, k=2)[0][:, 1]))

    def measured(self, clearance: float) -> float:
        """Returns the distance to the points that makes sure of one to their surface, both [m].

        A point of a flat surface is at most spacing / sqrt(2) from a sample of a square pattern,
        so a distance d to the samples leaves at least sqrt(d^2 - spacing^2 / 2) to the surface.
        """
        return float(np.sqrt(clearance**2 + 0.5 * self.spacing**2))

    def distance(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Returns the distance (...) from each point (..., 3) to the scene, at most `reach` [m].

        It is negative below the ground.

        Args:
            points: (..., 3) query points [m, world].
            reach: Farthest distance of interest [m]; a smaller value is faster.
        """
        distance = self.distance_to_points(points, reach)
        if self.ground_height is not None:
            np.minimum(distance, points[..., 2] - self.ground_height, out=distance)
        return distance

    def distance_to_points(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Returns the distance (...) from each point (..., 3) to the scene's points alone [m].

        Args:
            points: (..., 3) query points [m, world].
            reach: Farthest distance of interest [m].
        """
        distance = np.full(points.shape[:-1], reach)
        if self._tree is not None:
            near = self.lower_bound(points) < reach
            if near.any():
                found, _ = self._tree.query(points[near], distance_upper_bound=reach)
                distance[near] = np.minimum(found, reach)
        return distance

    def lower_bound(self, points: np.ndarray) -> np.ndarray:
        """Returns numbers (...) not above the distance of points (..., 3) to the scene's [m].

        They are less than the distance by up to two diagonals of a voxel, and outside the grid no
        larger than its border.
        """
        if self._tree is None:
            return np.full(points.shape[:-1], np.inf)
        cells = (points - self._origin) * self._per_edge
        # The outermost voxels hold the border, so what lies outside may be led into them.
        np.clip(cells, 0.0, self._last, out=cells)
        return self._bounds.take(cells.astype(np.int32) @ self._strides)

    def _fill_grid(self, config: SceneDistanceConfig) -> None:
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        edge = config.voxel_size
        while True:
            # One more voxel on each side for what lies outside.
            origin = low - config.border - edge
            shape = np.ceil((high - low + 2.0 * config.border) / edge).astype(int) + 2
            if np.prod(shape.astype(float)) <= config.max_voxels:
                break
            edge *= 1.1
        occupied = ((self.points - origin) / edge).astype(int)
        empty = np.ones(shape, dtype=bool)
        empty[tuple(occupied.T)] = False
        # Between voxel centres; the point may be half a diagonal off the centre of its voxel.
        half_diagonal = 0.5 * np.sqrt(3.0) * edge
        centres_apart = distance_transform_edt(empty) * edge
        bounds = centres_apart - half_diagonal
        # Close to the points the distance of the centres is worth looking up.
        near = centres_apart < 3.0 * edge
        centres = origin + (np.argwhere(near) + 0.5) * edge
        assert self._tree is not None
        bounds[near] = self._tree.query(centres)[0]
        bounds = np.maximum(bounds - half_diagonal, 0.0)
        for axis in range(3):
            for side in (0, -1):
                np.moveaxis(bounds, axis, 0)[side] = config.border
        self._origin, self._per_edge = origin, 1.0 / edge
        self._last = shape - 0.5
        self._strides = np.array([shape[1] * shape[2], shape[2], 1], dtype=np.int32)
        self._bounds = np.ascontiguousarray(bounds, dtype=float).ravel()
