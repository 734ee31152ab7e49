"""Where the gripper may be: its boxes against the points of object, part and scene."""

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.grasping.candidates.grasp_candidate import GraspSamplingConfig


class GraspScene:
    """The points around one object, and whether a gripper stands clear of them.

    Attributes:
        object_points: (P, 3) the whole object [m, world].
        part_points: (M, 3) its functional part [m, world].
        obstacle_points: (Q, 3) everything near it that must not be touched [m, world].
        ground_height: Height of the table [m], or None.
    """

    def __init__(
        self,
        *,
        object_points: np.ndarray,
        part_points: np.ndarray,
        obstacle_points: np.ndarray,
        ground_height: float | None,
        config: GraspSamplingConfig,
    ):
        """Keeps the obstacle points that a gripper at the object can reach.

        Args:
            object_points: (P, 3) the whole object [m, world].
            part_points: (M, 3) its functional part [m, world].
            obstacle_points: (Q, 3) everything that must not be touched [m, world].
            ground_height: Height of the table [m], or None; its points are not obstacles.
            config: Clearances and the gripper's shape.
        """
        self._config = config
        self.object_points = object_points
        self.part_points = part_points
        self.ground_height = ground_height
        center = object_points.mean(axis=0)
        radius = np.linalg.norm(object_points - center, axis=1).max()
        reach = radius + config.approach_length + np.linalg.norm(config.gripper.hand_size)
        near = np.linalg.norm(obstacle_points - center, axis=1) < reach
        if ground_height is not None:
            near &= obstacle_points[:, 2] > ground_height + config.ground_clearance
        self.obstacle_points = obstacle_points[near]

    def is_clear(self, X_WG: np.ndarray, opening: float) -> bool:
        """Returns whether an open gripper and its way in are clear of everything.

        Args:
            X_WG: (4, 4) gripper pose at the grasp [m, world].
            opening: Distance between the pads [m].
        """
        config = self._config
        lower, upper = _gripper_boxes(config, opening)
        if not self._is_above_ground(X_WG, lower, upper):
            return False
        X_GW = inverse(X_WG)
        swept = lower.copy()
        swept[:, 2] -= config.approach_length
        for points in (self.object_points, self.obstacle_points):
            points_G = transform_points(X_GW, points)
            if _count_inside(points_G, swept, upper) > config.max_stray_points:
                return False
        if len(self.part_points):
            part_G = transform_points(X_GW, self.part_points)
            # The fingers sweep the room between them when they close.
            if _distance_to_boxes(part_G, *_with_closing_room(lower, upper)) < (
                config.part_clearance
            ):
                return False
        return True

    def _is_above_ground(self, X_WG: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> bool:
        if self.ground_height is None:
            return True
        corners = np.where(X_WG[2, :3] < 0.0, upper, lower)  # of each box, the lowest in the world
        lowest = (corners @ X_WG[2, :3]).min() + X_WG[2, 3]
        return bool(lowest > self.ground_height + self._config.ground_clearance)


def _gripper_boxes(config: GraspSamplingConfig, opening: float) -> tuple[np.ndarray, np.ndarray]:
    lower, upper = config.gripper.finger_boxes(opening)
    hand_lower, hand_upper = config.gripper.hand_box()
    return np.vstack([lower, hand_lower]), np.vstack([upper, hand_upper])


def _with_closing_room(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the boxes and the room between the finger tips."""
    room_lower, room_upper = lower[0].copy(), upper[0].copy()
    room_lower[1], room_upper[1] = upper[2, 1], lower[0, 1]
    return np.vstack([lower, room_lower]), np.vstack([upper, room_upper])


def _count_inside(points: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> int:
    # Only points inside the box around all boxes are worth a closer look.
    points = points[
        np.logical_and.reduce(
            [
                (points[:, k] > lower[:, k].min()) & (points[:, k] < upper[:, k].max())
                for k in (1, 2, 0)
            ]
        )
    ]
    if not len(points):
        return 0
    inside = np.all((points > lower[:, None]) & (points < upper[:, None]), axis=-1)
    return int(np.count_nonzero(inside.any(axis=0)))


def _distance_to_boxes(points: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    outside = np.maximum(lower[:, None] - points, points - upper[:, None])
    return float(np.linalg.norm(np.maximum(outside, 0.0), axis=-1).min())
