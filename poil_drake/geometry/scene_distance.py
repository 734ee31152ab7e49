"""Distance to a scene that is known as surface points and a ground plane."""

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.frozen_array import frozen_array

_GROUND_THICKNESS = 0.004
"""Points less than this above the ground belong to it [m]; about a depth camera's noise."""


class SceneDistance:
    """Obstacle points and a ground plane, indexed for distance queries.

    Distances are to the points. The surface that the points were sampled from may be nearer; see
    `measured`.

    Attributes:
        points: (P, 3) obstacle points [m, world], without the ground's.
        ground_height: Height of the ground [m]; None without a ground.
        spacing: Typical distance between neighbouring points [m]; 0 with fewer than two.
    """

    def __init__(self, points: np.ndarray, *, ground_height: float | None = None):
        """Indexes the points.

        Args:
            points: (P, 3) surface points of all obstacles [m, world].
            ground_height: Height of the table in the world [m]. It is modelled as a plane because
                cameras see only part of it. None for no table.
        """
        points = frozen_array(points, name="SceneDistance.points", shape=("P", 3))
        if ground_height is not None:
            points = points[points[:, 2] > ground_height + _GROUND_THICKNESS]
        self.points = frozen_array(points, name="SceneDistance.points", shape=("P", 3))
        self.ground_height = ground_height
        self._tree = cKDTree(self.points)
        self.spacing = 0.0
        if len(self.points) > 1:
            subset = self.points[:: max(len(self.points) // 2000, 1)]
            self.spacing = float(np.median(self._tree.query(subset, k=2)[0][:, 1]))

    def measured(self, clearance: float) -> float:
        """Returns the distance to the points that guarantees a clearance to their surface [m].

        A point of a flat surface is at most spacing / sqrt(2) from a sample of a square pattern,
        so a distance d to the samples leaves at least sqrt(d^2 - spacing^2 / 2) to the surface.
        """
        return float(np.sqrt(clearance**2 + 0.5 * self.spacing**2))

    def distance_to_points(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Returns the distances (...) of points (..., 3) to the scene's points, at most `reach`.

        Args:
            points: (..., 3) query points [m, world].
            reach: Largest distance of interest [m]; smaller values are faster.
        """
        distance, _ = self._tree.query(points, distance_upper_bound=reach)
        return np.minimum(distance, reach)
