"""What safe entry knows: the object as a rigid body, the scene, and the clearance demonstrated."""

import numpy as np

from poil_drake.control.entry.entry_clearance import (
    EntryClearanceConfig,
    EntryStart,
    enough_clearance,
)
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.control.theory.stability import moment_matrix, point_inertia
from poil_drake.errors import TrackingError
from poil_drake.geometry.body_clearance import BodyClearance
from poil_drake.geometry.point_cloud import PointCloud, voxel_downsample
from poil_drake.geometry.rigid_consensus import RigidConsensusConfig, rigid_inliers
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.geometry.scene_distance import SceneDistance
from poil_drake.planning.path_shortening import EdgeChecker
from poil_drake.planning.pose_vectors import poses_of


class EntryModel:
    """The object, the scene and the reference between them.

    The body frame B has its origin in the middle of the object's cloud, with the world's axes at
    the time the cloud was seen.

    Attributes:
        reference: Where the points should go.
        scene: What the object must not touch.
        points: (N, 3) the points [m, B].
        radius: Distance of the farthest point of the cloud from B's origin [m].
        poses: (T, 4, 4) X_WB along the reference.
        clearances: (T,) distance of the object to the scene's points along the reference, at most
            `reach` [m].
        heights: (T,) of the object above the ground along the reference [m].
        free: (T,) bool, where the reference keeps the margin.
        contact: First sample of the last stretch that does not keep the margin; T if the end
            keeps it.
        reach: Distance to the scene's points that makes sure of the margin [m].
    """

    def __init__(
        self,
        *,
        reference: PointTrajectory,
        scene: SceneDistance,
        object_cloud: np.ndarray,
        object_points: np.ndarray,
        config: EntryClearanceConfig | None = None,
    ):
        """Fits the object to the reference and measures its clearance there.

        Args:
            reference: Where the points should go.
            scene: What the object must not touch.
            object_cloud: (Q, 3) surface of the object at one time [m, world].
            object_points: (N, 3) where the reference's points were at that time [m, world]; NaN
                where not observed.
            config: Margins.

        Raises:
            TrackingError: if fewer than three of the points are finite.
        """
        self.reference = reference
        self.scene = scene
        self._config = config or EntryClearanceConfig()
        cloud = PointCloud(object_cloud)
        cloud = voxel_downsample(cloud, self._config.cloud_spacing)
        middle = 0.5 * (cloud.points.min(axis=0) + cloud.points.max(axis=0))
        shape = reference.positions[-1]
        weights = _weights(shape, object_points, None, self._config.rigidity)
        self.points = transform_points(kabsch(shape, object_points, weights), shape) - middle
        self._body = BodyClearance(cloud=cloud.points - middle, scene=scene)
        self.radius = self._body.radius
        self.reach = scene.measured(self._config.margin)
        positions = reference.positions
        self.poses = kabsch(np.broadcast_to(self.points, positions.shape), positions)
        self.clearances = self._body.clearance(self.poses, self.reach)
        self.heights = self._body.height(self.poses)
        self.free = (self.clearances >= self.reach) & (self.heights >= self._config.margin)
        (free,) = np.nonzero(self.free)
        self.contact = int(free[-1]) + 1 if free.size else 0
        # A step ds along an edge shifts the origin by dp and turns the quaternion by dq, with
        # dp^2 + dq^2 <= ds^2. Where the edge cuts across, the quaternion is as short as 1 / sqrt(2)
        # of its length at the ends, so a point moves by dp + sqrt(2) dq <= sqrt(3) ds.
        self._edge_step = self._config.resolution / np.sqrt(3.0)

    def is_contact(self, remaining: float) -> bool:
        """Returns whether the reference is past its first lasting contact at a time before its end.

        Args:
            remaining: Time to the end of the reference [s], or of one that ends like it.
        """
        times = self.reference.times
        return self.contact < len(times) and remaining <= times[-1] - times[self.contact]

    def pose(self, points: np.ndarray, confidence: np.ndarray | None = None) -> np.ndarray:
        """Returns the pose X_WB (4, 4) of the object at points (N, 3) [m, world].

        Args:
            points: (N, 3); NaN where not observed.
            confidence: (N,) weights; None for all equal.

        Raises:
            TrackingError: if fewer than three points are observed.
        """
        weights = _weights(self.points, points, confidence, self._config.rigidity)
        return kabsch(self.points, points, weights)

    def start(self, points: np.ndarray, confidence: np.ndarray | None = None) -> EntryStart:
        """Returns the start of a motion of the object from where its points are.

        With residuals of standard deviation s along each axis and the points' inertia A, the pose
        turns by s^2 A^-1 and shifts by s^2 / N (variances of least squares).

        Args:
            points: (N, 3) [m, world]; NaN where not observed.
            confidence: (N,) weights; None for all equal.

        Raises:
            TrackingError: if fewer than three points are observed.
        """
        weights = _weights(self.points, points, confidence, self._config.rigidity)
        X_WB = kabsch(self.points, points, weights)
        seen = weights > 0.0
        residuals = points[seen] - transform_points(X_WB, self.points[seen])
        freedom = max(residuals.size - 6, 1)
        # What is explained by deformation tells nothing of noise.
        explained = np.count_nonzero(seen) * self._config.deformation**2
        variance = max(float(np.sum(residuals**2)) - explained, 0.0) / freedom
        centroid = self.points[seen].mean(axis=0)
        inertia = point_inertia(moment_matrix(self.points[seen]))
        lever = float(np.linalg.norm(centroid)) + self.radius
        turned = lever**2 * float(np.trace(np.linalg.pinv(inertia)))
        spread = np.sqrt(variance * (3.0 / np.count_nonzero(seen) + turned))
        return EntryStart(
            X_WB,
            clearance=float(self._body.clearance(X_WB[None], self.reach)[0]),
            height=float(self._body.height(X_WB[None])[0]),
            slack=min(self._config.deviations * float(spread), self._config.margin),
        )

    def clearance(self, X_WB: np.ndarray, reach: float) -> np.ndarray:
        """Returns the clearance (B,) at poses (B, 4, 4) to points and ground, at most `reach` [m].

        It is negative where the object is below the ground.
        """
        return np.minimum(self._body.clearance(X_WB, reach), self._body.height(X_WB))

    def bounds(self, start: EntryStart, room: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns corners (3,) of a box in which a motion can go around everything [m, world].

        Args:
            start: Where it begins.
            room: What is left beside the object, start, scene and reference [m].
        """
        origins = [start.X_WB[None, :3, 3], self.poses[:, :3, 3]]
        beyond = self.radius + room
        known = np.concatenate([*origins, self.scene.points])
        lower, upper = known.min(axis=0) - beyond, known.max(axis=0) + beyond
        if self.scene.ground_height is not None:
            lowest = min(float(o[:, 2].min()) for o in origins)
            lower[2] = min(max(lower[2], self.scene.ground_height), lowest)
        return lower, upper

    def displacement(self, X_WA: np.ndarray, X_WB: np.ndarray) -> np.ndarray:
        """Returns how far (A, B) a point of the object gets from poses (A, 4, 4) to (B, 4, 4) [m].

        A bound: |p| + radius * angle.
        """
        apart = X_WA[:, None, :3, 3] - X_WB[None, :, :3, 3]
        traces = X_WA[:, :3, :3].reshape(-1, 9) @ X_WB[:, :3, :3].reshape(-1, 9).T
        angles = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0))
        return np.sqrt(np.einsum("abi,abi->ab", apart, apart)) + self.radius * angles

    def is_free(self, X_WB: np.ndarray, start: EntryStart) -> np.ndarray:
        """Returns which poses (B, 4, 4) keep the clearance demanded of a motion: (B,) bool.

        See `enough_clearance`.
        """
        clearance, height = self._body.clearance(X_WB, self.reach), self._body.height(X_WB)
        free = (clearance >= self.reach) & (height >= self._config.margin)
        (close,) = np.nonzero(~free)
        if close.size:
            X, clearance, height = X_WB[close], clearance[close], height[close]
            free[close] = enough_clearance(
                clearance,
                height,
                start,
                left=self.displacement(X, start.X_WB[None])[:, 0],
                shown_clearances=self.clearances,
                shown_heights=self.heights,
                away=self.displacement(X, self.poses),
                reach=self.reach,
                config=self._config,
            )
        return free

    def edges(self, start: EntryStart) -> EdgeChecker:
        """Returns the check of straight edges between pose vectors, for a motion from `start`."""
        return EdgeChecker(lambda vectors: self.is_free(poses_of(vectors), start), self._edge_step)


def _weights(
    shape: np.ndarray,
    points: np.ndarray,
    confidence: np.ndarray | None,
    rigidity: RigidConsensusConfig,
) -> np.ndarray:
    """Returns the weights (N,) of points that are observed and fit the shape, zero elsewhere."""
    weights = np.isfinite(points).all(axis=1).astype(float)
    if confidence is not None:
        weights *= np.where(np.isfinite(confidence), confidence, 0.0)
    (seen,) = np.nonzero(weights > 0.0)
    if seen.size < 3:
        raise TrackingError(
            f"Only {seen.size} of {len(points)} points are observed.",
            remedy="Wait for three points that are not on a line.",
        )
    weights[seen] *= rigid_inliers(shape[seen], points[seen], weights[seen], config=rigidity)
    return weights
