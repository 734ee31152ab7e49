"""Clearance of a rigid body, given as a surface cloud, to a scene, at many poses at once."""

import numpy as np

from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.geometry.scene_cloud import SceneCloud


class BodyClearance:
    """Distance of a body's cloud to a scene's points, and the body's height above the ground.

    Attributes:
        cloud: (Q, 3) the body's surface [m, body frame].
        radius: Largest distance of the cloud's points from the frame's origin [m].
    """

    def __init__(self, *, cloud: np.ndarray, scene: SceneCloud):
        """Stores the body and the scene.

        Args:
            cloud: (Q, 3) the body's surface [m], not empty, with the frame's origin in its middle.
            scene: The obstacles and the ground.
        """
        self.cloud = cloud
        self.radius = float(np.linalg.norm(cloud, axis=1).max())
        self._scene = scene

    def clearance(self, X_WB: np.ndarray, reach: float) -> np.ndarray:
        """Returns the distance (B,) to the scene's points at poses (B, 4, 4) [m], at most `reach`.

        Args:
            X_WB: (B, 4, 4) poses of the body.
            reach: Largest distance of interest [m]; smaller values are faster.
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
        """Returns the height (B,) of the body's lowest point above the ground [m].

        It is negative below the ground, and infinite without one.

        Args:
            X_WB: (B, 4, 4) poses of the body.
        """
        if self._scene.ground_height is None:
            return np.full(len(X_WB), np.inf)
        lowest = (X_WB[:, 2, :3] @ self.cloud.T).min(axis=1)
        return X_WB[:, 2, 3] + lowest - self._scene.ground_height
