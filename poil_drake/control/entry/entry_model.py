"""The object as a rigid body, the scene, and the clearance along the demonstration."""

from functools import partial

import numpy as np

from poil_drake.control.entry.entry_clearance import (
    RESOLUTION,
    TOLERANCE,
    EntryClearanceConfig,
    EntryStart,
    required_clearance,
)
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.control.theory.stability import moment_matrix, point_inertia
from poil_drake.errors import TrackingError
from poil_drake.geometry.point_cloud import PointCloud, voxel_downsample
from poil_drake.geometry.rigid_fit import kabsch, rigid_inliers
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.geometry.scene_cloud import BodyClearance, SceneCloud
from poil_drake.planning.path_shortening import EdgeChecker
from poil_drake.planning.rrt_connect import poses_of

_INLIER_DISTANCE = 0.012
"""Points farther than this from their place on the object are left out of the fit of its pose [m].
12 mm allows for 3 mm of noise on each axis and for the bending of a bag's handle."""

_CLOUD_SPACING = 0.006
"""The object's cloud is thinned to one point per cube of this edge [m]."""

_DEVIATIONS = 2.0
"""How many standard deviations of the object's pose to subtract from the required clearance.
Otherwise the noise of the pose would look like a collision in a narrow hole."""


class EntryModel:
    """The object, the scene, and the object's poses and clearances along the reference.

    The body frame B has its origin in the middle of the object's cloud. When the cloud was
    observed, its axes were those of the world.

    Attributes:
        reference: The reference of the points.
        scene: The obstacles.
        points: (N, 3) the points [m, B].
        radius: Largest distance of the cloud's points from B's origin [m].
        poses: (T, 4, 4) X_WB along the reference.
        clearances: (T,) distances from the object to the scene's points along the reference, at
            most `reach` [m].
        heights: (T,) heights of the object above the ground along the reference [m].
        free: (T,) bool, where the reference keeps the margin.
        contact: First sample of the last stretch that does not keep the margin; T if the end keeps
            it.
        contact_left: Time left until the reference's end at `contact` [s]; negative if there is no
            contact at the end.
        reach: Distance to the scene's points that guarantees the margin to their surface [m].
    """

    def __init__(
        self,
        *,
        reference: PointTrajectory,
        scene: SceneCloud,
        object_cloud: np.ndarray,
        object_points: np.ndarray,
        config: EntryClearanceConfig,
    ):
        """Fits the object to the reference and measures its clearance along the reference.

        Args:
            reference: The reference of the points.
            scene: The obstacles.
            object_cloud: (Q, 3) surface of the object at one time [m, world].
            object_points: (N, 3) positions of the reference's points at that time [m, world]; NaN
                where not observed.
            config: The required clearance.

        Raises:
            TrackingError: if fewer than three of the points are finite.
        """
        self.reference = reference
        self.scene = scene
        self._config = config
        cloud = voxel_downsample(PointCloud(object_cloud), _CLOUD_SPACING)
        middle = 0.5 * (cloud.points.min(axis=0) + cloud.points.max(axis=0))
        shape = reference.positions[-1]
        X, _ = _fit_pose(shape, object_points, None)
        self.points = transform_points(X, shape) - middle
        self._body = BodyClearance(cloud=cloud.points - middle, scene=scene)
        self.radius = self._body.radius
        self.reach = scene.measured(config.margin)
        positions = reference.positions
        self.poses = kabsch(np.broadcast_to(self.points, positions.shape), positions)
        self.clearances = self._body.clearance(self.poses, self.reach)
        self.heights = self._body.height(self.poses)
        self.free = (self.clearances >= self.reach) & (self.heights >= config.margin)
        (free,) = np.nonzero(self.free)
        self.contact = int(free[-1]) + 1 if free.size else 0
        left = reference.times[-1] - reference.times[self.contact :]
        self.contact_left = float(left[0]) if left.size else -1.0

    def pose(self, points: np.ndarray) -> np.ndarray:
        """Returns the pose X_WB (4, 4) of the object, fitted to its points.

        Args:
            points: (N, 3) [m, world]; NaN where not observed.

        Raises:
            TrackingError: if fewer than three points are observed.
        """
        return _fit_pose(self.points, points, None)[0]

    def start(self, points: np.ndarray, confidence: np.ndarray | None = None) -> EntryStart:
        """Returns the object's pose, clearance and uncertainty at the start of a motion.

        With residuals of standard deviation s along each axis and the points' inertia A, the pose
        has the variances s^2 A^-1 in rotation and s^2 / N in translation (least squares).

        Args:
            points: (N, 3) [m, world]; NaN where not observed.
            confidence: (N,) weights; None for all equal.

        Raises:
            TrackingError: if fewer than three points are observed.
        """
        X_WB, inliers = _fit_pose(self.points, points, confidence)
        count = np.count_nonzero(inliers)
        residuals = points[inliers] - transform_points(X_WB, self.points[inliers])
        # Deformation explains a part of the residuals, which is not noise.
        explained = count * self._config.deformation**2
        variance = max(float(np.sum(residuals**2)) - explained, 0.0) / max(residuals.size - 6, 1)
        centroid = self.points[inliers].mean(axis=0)
        inertia = point_inertia(moment_matrix(self.points[inliers]))
        lever = float(np.linalg.norm(centroid)) + self.radius
        turned = lever**2 * float(np.trace(np.linalg.pinv(inertia)))
        deviation = float(np.sqrt(variance * (3.0 / count + turned)))
        return EntryStart(
            X_WB,
            clearance=float(self._body.clearance(X_WB[None], self.reach)[0]),
            height=float(self._body.height(X_WB[None])[0]),
            uncertainty=min(_DEVIATIONS * deviation, self._config.margin),
        )

    def clearance(self, X_WB: np.ndarray, reach: float) -> np.ndarray:
        """Returns the object's clearances (B,) to scene and ground at poses (B, 4, 4) [m].

        Clearances are negative below the ground, and at most `reach` [m].
        """
        return np.minimum(self._body.clearance(X_WB, reach), self._body.height(X_WB))

    def bounds(self, start: EntryStart, room: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns the lower and upper corner (3,) of a box with room to pass obstacles [m, world].

        Args:
            start: Start of the motion.
            room: Space to leave for the object around the start, the scene and the reference [m].
        """
        origins = np.concatenate([start.X_WB[None, :3, 3], self.poses[:, :3, 3]])
        known = np.concatenate([origins, self.scene.points])
        beyond = self.radius + room
        lower, upper = known.min(axis=0) - beyond, known.max(axis=0) + beyond
        if self.scene.ground_height is not None:
            lower[2] = min(max(lower[2], self.scene.ground_height), origins[:, 2].min())
        return lower, upper

    def displacement(self, X_WA: np.ndarray, X_WB: np.ndarray) -> np.ndarray:
        """Returns upper bounds (A, B) on the motion of the object's points between two poses [m].

        The bound is the distance between the origins plus `radius` times the angle of rotation.

        Args:
            X_WA: (A, 4, 4) first poses.
            X_WB: (B, 4, 4) second poses.
        """
        apart = X_WA[:, None, :3, 3] - X_WB[None, :, :3, 3]
        traces = X_WA[:, :3, :3].reshape(-1, 9) @ X_WB[:, :3, :3].reshape(-1, 9).T
        angles = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0))
        return np.sqrt(np.einsum("abi,abi->ab", apart, apart)) + self.radius * angles

    def is_free(self, X_WB: np.ndarray, start: EntryStart) -> np.ndarray:
        """Returns which poses keep the required clearance: (B,) bool.

        The required clearance is the margin. It is less near the start and near demonstrated poses
        that have less clearance themselves; see `required_clearance`. An object that starts closer
        to the ground than the margin may stay as low during the whole motion.

        Args:
            X_WB: (B, 4, 4) poses of the object.
            start: Start of the motion.
        """
        margin = self._config.margin
        clearance, height = self._body.clearance(X_WB, self.reach), self._body.height(X_WB)
        free = (clearance >= self.reach) & (height >= margin)
        (close,) = np.nonzero(~free)
        if close.size == 0:
            return free
        tolerance = TOLERANCE + start.uncertainty
        required = partial(
            required_clearance, tolerance=tolerance, tube_radius=self._config.tube_radius
        )
        from_reference = self.displacement(X_WB[close], self.poses)
        from_start = self.displacement(X_WB[close], start.X_WB[None])[:, 0]
        distance = np.minimum(
            required(self.clearances, from_reference, self.reach).min(axis=1),
            required(start.clearance, from_start, self.reach),
        )
        lowest = required(self.heights, from_reference, margin).min(axis=1)
        if start.height < margin:
            lowest = np.minimum(lowest, start.height - tolerance)
        free[close] = clearance[close] >= np.minimum(self.reach, distance)
        free[close] &= height[close] >= np.minimum(margin, lowest)
        return free

    def edges(self, start: EntryStart) -> EdgeChecker:
        """Returns the check of edges between pose vectors, for a motion that starts at `start`."""
        # A step ds along an edge shifts the origin by dp and turns the quaternion by dq, with
        # dp^2 + dq^2 <= ds^2. Where the edge cuts across, the quaternion is as short as 1 / sqrt(2)
        # of its length at the ends, so a point moves by dp + sqrt(2) dq <= sqrt(3) ds.
        return EdgeChecker(
            lambda vectors: self.is_free(poses_of(vectors), start), RESOLUTION / np.sqrt(3.0)
        )


def _fit_pose(
    shape: np.ndarray, points: np.ndarray, confidence: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the pose (4, 4) that fits a shape to observed points, and the inliers (N,) bool."""
    weights = np.isfinite(points).all(axis=1).astype(float)
    if confidence is not None:
        weights *= np.where(np.isfinite(confidence), confidence, 0.0)
    (seen,) = np.nonzero(weights > 0.0)
    if seen.size < 3:
        raise TrackingError(
            f"Only {seen.size} of {len(points)} points are observed; a pose needs 3.",
            remedy="Wait until three points that are not collinear are observed.",
        )
    weights[seen] *= rigid_inliers(shape[seen], points[seen], weights[seen], _INLIER_DISTANCE)
    return kabsch(shape, points, weights), weights > 0.0
