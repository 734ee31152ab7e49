"""The robot's clearance from itself and from a scene that is known as a point cloud."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import RobotSpheres

_RESTING_LINKS = (0, 1)
"""Links that do not move or only turn about their own axis; they may touch the robot's stand."""

_SHOULDER_LINKS, _WRIST_LINKS = (0, 1, 2), (5, 6, 7, 8)
"""Links of the first group can touch links of the second group within the joint limits."""


@dataclass(frozen=True, kw_only=True)
class CollisionConfig:
    """Margins of the collision checks.

    Attributes:
        robot_margin: Clearance that the robot's spheres must keep from the scene [m]. It covers
            depth noise and the arm's tracking error. The spheres bulge beyond the robot by another
            5-10 mm.
        object_margin: Clearance that the carried object must keep from the scene [m].
        ground_height: Height of the table in the world [m]; None without a table. The table is an
            infinite plane, because the cameras see only part of it.
        max_distance: Cap on the reported distances [m]; a smaller cap makes the checks faster.
    """

    robot_margin: float = 0.008
    object_margin: float = 0.006
    ground_height: float | None = field(default=0.0, metadata={"yaml": False})
    max_distance: float = field(default=0.06, metadata={"yaml": False})


class RobotCollisionChecker:
    """Computes the clearance of the robot's spheres from a scene and from the robot itself."""

    def __init__(
        self,
        *,
        model: PandaModel,
        spheres: RobotSpheres,
        scene: SceneCloud,
        config: CollisionConfig | None = None,
    ):
        """Prepares the check.

        Args:
            model: The arm's kinematics.
            spheres: The robot's shape.
            scene: The obstacles.
            config: Margins, and the cap on distances.
        """
        self._config = config or CollisionConfig()
        self._model = model
        self._scene = scene
        groups = [_LinkGroup.of(spheres, link) for link in np.unique(spheres.links)]
        self._moving = [group for group in groups if group.link not in _RESTING_LINKS]
        self._wrist = [group for group in groups if group.link in _WRIST_LINKS]
        own = np.isin(spheres.links, _SHOULDER_LINKS)
        self._shoulder = spheres.links[own], spheres.centers[own], spheres.radii[own]

    def smallest_clearance(self, q: np.ndarray, reach: float = np.inf) -> float:
        """Returns the smallest clearance of a motion from the scene and from the robot itself [m].

        Args:
            q: (B, 7) joint positions along the motion [rad], B >= 1.
            reach: Cap on the result [m], if it is below `CollisionConfig.max_distance`.
        """
        poses = self._model.link_poses(q)
        smallest = min(reach, float(self.self_clearance(poses).min()))
        for group in reversed(self._moving):  # The hand is likely to be the nearest.
            smallest = float(self._scene_clearance(poses, group, np.full(len(q), smallest)).min())
        return smallest

    def is_free(self, q: np.ndarray) -> np.ndarray:
        """Returns (B,) bool: whether each `q` (B, 7) keeps `robot_margin` and clear of itself."""
        poses = self._model.link_poses(q)
        free = self.self_clearance(poses) > 0.0
        free[free] = self.scene_clearance(poses[free]) > self._config.robot_margin
        return free

    def scene_clearance(self, link_poses: np.ndarray) -> np.ndarray:
        """Returns the scene clearance (B,) [m], at most `max_distance`, at poses (B, 9, 4, 4)."""
        clearance = np.full(len(link_poses), self._config.max_distance)
        for group in self._moving:
            clearance = self._scene_clearance(link_poses, group, clearance)
        return clearance

    def _scene_clearance(
        self, link_poses: np.ndarray, group: "_LinkGroup", known: np.ndarray
    ) -> np.ndarray:
        """Returns the smaller of a link's clearance from the scene and `known`, (B,) [m]."""
        X, reach = link_poses[:, group.link], float(known.max())
        center = _to_world(X, group.bound_center)
        bound = self._scene.distance(center, reach + group.bound_radius) - group.bound_radius
        near = np.flatnonzero(bound < known)
        if not near.size:
            return known
        centers = _to_world(X[near, None], group.centers)
        own = self._scene.distance(centers, reach + float(group.radii.max())) - group.radii
        clearance = known.copy()
        clearance[near] = np.minimum(known[near], own.min(axis=1))
        return clearance

    def self_clearance(self, link_poses: np.ndarray) -> np.ndarray:
        """Returns the clearance (B,) [m] between shoulder and wrist, at most `max_distance`.

        The link poses are (B, 9, 4, 4), as from `PandaModel.link_poses`.
        """
        links, centers, radii = self._shoulder
        centers = _to_world(link_poses[:, links], centers)
        bounds = _to_world(
            link_poses[:, [group.link for group in self._wrist]],
            np.array([group.bound_center for group in self._wrist]),
        )
        gaps = np.linalg.norm(bounds[:, :, None] - centers[:, None], axis=-1) - radii
        clearance = np.full(len(link_poses), self._config.max_distance)
        for group, gap in zip(self._wrist, gaps.min(axis=2).T, strict=True):
            near = np.flatnonzero(gap - group.bound_radius < clearance)
            if near.size:
                own = _to_world(link_poses[near, None, group.link], group.centers)[:, :, None]
                gaps = np.linalg.norm(own - centers[near, None], axis=-1)
                gaps -= group.radii[:, None] + radii
                clearance[near] = np.minimum(clearance[near], gaps.min(axis=(1, 2)))
        return clearance


@dataclass(frozen=True)
class _LinkGroup:
    """The spheres of one link and their bounding sphere, in the link's frame."""

    link: int
    centers: np.ndarray
    radii: np.ndarray
    bound_center: np.ndarray
    bound_radius: float

    @classmethod
    def of(cls, spheres: RobotSpheres, link: int) -> "_LinkGroup":
        own = spheres.links == link
        centers, radii = spheres.centers[own], spheres.radii[own]
        lower = (centers - radii[:, None]).min(axis=0)
        upper = (centers + radii[:, None]).max(axis=0)
        center = 0.5 * (lower + upper)
        bound = float((np.linalg.norm(centers - center, axis=1) + radii).max())
        return cls(int(link), centers, radii, center, bound)


def _to_world(X: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Transforms `points` (..., 3), each given in its frame `X` (..., 4, 4), to the world frame."""
    return (X[..., :3, :3] @ points[..., None])[..., 0] + X[..., :3, 3]
