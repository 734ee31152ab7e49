"""Computes how far a rigid body is from a scene, at many poses at once."""

import numpy as np

from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.geometry.scene_cloud import SceneCloud


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
