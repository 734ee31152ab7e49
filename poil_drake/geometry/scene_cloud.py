"""A scene given as surface points and a ground plane, and the clearance of bodies from it."""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.geometry.rigid_transform import transform_points


class SceneCloud:
    """Obstacle points and a ground plane, indexed for distance queries.

    Distances are to the points. The surface from which the points were sampled may be nearer; see
    `measured`.

    Attributes:
        points: (P, 3) obstacle points [m, world]; points of the ground are not among them.
        ground_height: Height of the ground in the world [m]; None if there is no ground.
    """

    def __init__(
        self,
        points: np.ndarray,
        *,
        ground_height: float | None = None,
        ground_thickness: float = 0.004,
    ):
        """Indexes the points.

        Args:
            points: (P, 3) surface points of all obstacles [m, world].
            ground_height: Height of the ground, e.g. a table, in the world [m]; None for no ground.
                The ground is modelled as a plane because cameras see only part of it.
            ground_thickness: Points up to this height above the ground count as ground [m]. The
                default is about a depth camera's noise.
        """
        points = frozen_array(points, name="SceneCloud.points", shape=("P", 3))
        if ground_height is not None:
            points = points[points[:, 2] > ground_height + ground_thickness]
        self.points = frozen_array(points, name="SceneCloud.points", shape=("P", 3))
        self.ground_height = ground_height
        self._ground_thickness = ground_thickness
        self._tree = cKDTree(self.points)

    @cached_property
    def spacing(self) -> float:
        """Median distance from a point to its nearest neighbour [m]; 0 for fewer than 2 points."""
        if len(self.points) < 2:
            return 0.0
        subset = self.points[:: max(len(self.points) // 2000, 1)]
        return float(np.median(self._tree.query(subset, k=2)[0][:, 1]))

    def measured(self, clearance: float) -> float:
        """Returns the distance from the points that guarantees a clearance from the surface [m].

        If the points form a square grid on a flat surface, every place on the surface is within
        spacing / sqrt(2) of a point. A distance d from the points therefore leaves a clearance of
        at least sqrt(d^2 - spacing^2 / 2).

        Args:
            clearance: Required distance from the surface [m].
        """
        return float(np.sqrt(clearance**2 + 0.5 * self.spacing**2))

    def distance_to_points(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Returns the distance (...) from each query point to the nearest obstacle point [m].

        Args:
            points: (..., 3) query points [m, world].
            reach: Upper limit of the returned distance [m]. A smaller reach is faster.
        """
        distance, _ = self._tree.query(points, distance_upper_bound=reach)
        return np.minimum(distance, reach)

    def distance(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Returns the distance (...) to the nearest obstacle point or the ground [m].

        It is negative below the ground. The arguments are those of `distance_to_points`.
        """
        distance = self.distance_to_points(points, reach)
        if self.ground_height is None:
            return distance
        return np.minimum(distance, points[..., 2] - self.ground_height)

    def with_points(self, points: np.ndarray) -> "SceneCloud":
        """Returns the scene with further obstacle points (P, 3) [m, world]."""
        return self._with(np.concatenate([self.points, points]))

    def without_points(self, points: np.ndarray, padding: float) -> "SceneCloud":
        """Returns the scene without obstacle points near the given points.

        Args:
            points: (Q, 3) [m, world].
            padding: Obstacle points closer than this to one of `points` are removed [m].
        """
        distance, _ = cKDTree(points).query(self.points, distance_upper_bound=padding)
        return self._with(self.points[np.isinf(distance)])

    def without_balls(self, centers: np.ndarray, radii: np.ndarray) -> "SceneCloud":
        """Returns the scene without the obstacle points inside balls.

        Args:
            centers: (S, 3) centres of the balls [m, world].
            radii: (S,) their radii [m].
        """
        inside = self._tree.query_ball_point(centers, radii)
        keep = np.ones(len(self.points), dtype=bool)
        keep[np.concatenate([np.asarray(found, dtype=int) for found in inside])] = False
        return self._with(self.points[keep])

    def _with(self, points: np.ndarray) -> "SceneCloud":
        return SceneCloud(
            points, ground_height=self.ground_height, ground_thickness=self._ground_thickness
        )


class BodyClearance:
    """Computes a body's distance from a scene's points and its height above the scene's ground.

    Attributes:
        cloud: (Q, 3) points on the body's surface [m, body frame].
        radius: Largest distance of these points from the body frame's origin [m].
    """

    def __init__(self, *, cloud: np.ndarray, scene: SceneCloud):
        """Stores the body and the scene.

        Args:
            cloud: (Q, 3) points on the body's surface [m, body frame], at least one. Queries are
                fastest if the frame's origin is in the middle of the body.
            scene: The obstacles and the ground.
        """
        self.cloud = cloud
        self.radius = float(np.linalg.norm(cloud, axis=1).max())
        self._scene = scene

    def clearance(self, X_WB: np.ndarray, reach: float) -> np.ndarray:
        """Returns the body's distance from the scene's points at each pose: (B,) [m].

        Args:
            X_WB: (B, 4, 4) poses of the body in the world.
            reach: Upper limit of the returned distance [m]. A smaller reach is faster.
        """
        clearance = np.full(len(X_WB), reach)
        # Only poses whose bounding ball comes within reach need the body's points.
        beyond = self.radius + reach
        (close,) = np.nonzero(self._scene.distance_to_points(X_WB[:, :3, 3], beyond) < beyond)
        if close.size:
            points = transform_points(X_WB[close], self.cloud)
            clearance[close] = self._scene.distance_to_points(points, reach).min(axis=1)
        return clearance

    def height(self, X_WB: np.ndarray) -> np.ndarray:
        """Returns the height of the body's lowest point above the ground at each pose: (B,) [m].

        The height is negative below the ground. It is infinite if the scene has no ground.

        Args:
            X_WB: (B, 4, 4) poses of the body in the world.
        """
        if self._scene.ground_height is None:
            return np.full(len(X_WB), np.inf)
        lowest = (X_WB[:, 2, :3] @ self.cloud.T).min(axis=1)
        return X_WB[:, 2, 3] + lowest - self._scene.ground_height
