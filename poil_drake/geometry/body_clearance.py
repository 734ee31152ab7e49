"""Clearance of a rigid body, known as a surface cloud, to a scene, at many poses at once."""

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.geometry.sampling import farthest_point_sampling
from poil_drake.geometry.scene_distance import SceneDistance


class BodyClearance:
    """Smallest distance between a body's cloud and a scene's points, and height above its ground.

    The distance is found on three levels, each for what the one before leaves open: a ball around
    the whole body, balls around patches of its surface, and the patches' points. So a dense cloud
    costs little more than a thin one, and slender obstacles do not slip between its points.

    Attributes:
        cloud: (Q, 3) the body's surface [m, body frame].
        radius: Distance of the farthest point of it from the frame's origin [m].
    """

    def __init__(self, *, cloud: np.ndarray, scene: SceneDistance, patches: int = 48):
        """Sorts the cloud into patches.

        Args:
            cloud: (Q, 3) the body's surface [m]; the frame's origin should be in its middle.
            scene: What the body must not touch.
            patches: How many balls cover the surface.
        """
        self.cloud = frozen_array(cloud, name="BodyClearance.cloud", shape=("Q", 3))
        if len(self.cloud) == 0:
            raise InvalidValueError(
                "BodyClearance.cloud is empty.", remedy="Pass points of the body's surface."
            )
        self.radius = float(np.linalg.norm(self.cloud, axis=1).max())
        self._scene = scene
        chosen = farthest_point_sampling(self.cloud, min(patches, len(self.cloud)))
        self._centers = self.cloud[chosen]
        apart, patch = cKDTree(self._centers).query(self.cloud)
        self._radii = np.zeros(len(chosen))
        np.maximum.at(self._radii, patch, apart)
        # Patches of fewer points than the largest repeat their centre.
        sizes = np.bincount(patch, minlength=len(chosen))
        self._members = np.repeat(self._centers[:, None], sizes.max(), axis=1)
        for k in range(len(chosen)):
            self._members[k, : sizes[k]] = self.cloud[patch == k]

    def clearance(self, X_WB: np.ndarray, reach: float) -> np.ndarray:
        """Returns the distance (B,) to the scene's points at poses (B, 4, 4) [m], at most `reach`.

        Args:
            X_WB: (B, 4, 4) poses of the body.
            reach: Largest distance of interest [m]; a smaller value is faster.
        """
        clearance = np.full(len(X_WB), reach)
        around = self._scene.distance_to_points(X_WB[:, :3, 3], self.radius + reach)
        (close,) = np.nonzero(around < self.radius + reach)
        if close.size == 0:
            return clearance
        X = X_WB[close]
        centers = transform_points(X, self._centers)
        pose, patch = np.nonzero(self._scene.lower_bound(centers) - self._radii < reach)
        if pose.size == 0:
            return clearance
        # A patch's centre is one of its points; its other points are no nearer than by its radius.
        farthest = reach + self._radii.max()
        found = self._scene.distance_to_points(centers[pose, patch], farthest)
        least = np.full(len(X), reach)
        np.minimum.at(least, pose, found)
        open_patches = found - self._radii[patch] < least[pose]
        pose, patch = pose[open_patches], patch[open_patches]
        if pose.size:
            # Row vectors: p_W = p_B R^T + t.
            points = self._members[patch] @ X[pose, :3, :3].swapaxes(-1, -2) + X[pose, None, :3, 3]
            np.minimum.at(least, pose, self._scene.distance_to_points(points, reach).min(axis=1))
        clearance[close] = least
        return clearance

    def height(self, X_WB: np.ndarray) -> np.ndarray:
        """Returns the height (B,) of the lowest point above the ground [m], negative below it.

        It is infinite where there is no ground.

        Args:
            X_WB: (B, 4, 4) poses of the body.
        """
        if self._scene.ground_height is None:
            return np.full(len(X_WB), np.inf)
        lowest = (X_WB[:, 2, :3] @ self.cloud.T).min(axis=1)
        return X_WB[:, 2, 3] + lowest - self._scene.ground_height
