"""Collision checks of the gripper's boxes against the points of object, part and scene."""

from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.grasping.candidates.grasp_candidate import GRIPPER

_APPROACH_LENGTH = 0.10  # [m] Free path of the gripper before the grasp.
_GROUND_CLEARANCE = 0.006  # [m] Distance that the gripper keeps from the table.
_MAX_STRAY_POINTS = 1  # Points inside the gripper's volume that count as noise.


@dataclass(eq=False, kw_only=True)
class GraspScene:
    """The points of an object and its surroundings, which the open gripper must not touch.

    Attributes:
        object_points: (P, 3) the whole object [m, world].
        part_points: (M, 3) its functional part [m, world].
        obstacle_points: (Q, 3) all obstacles [m, world]. Those out of the reach of a gripper at the
            object, and those on the table, are left out.
        ground_height: Height of the table [m]; None without a table.
        part_clearance: Distance that the gripper keeps from the part [m].
    """

    object_points: np.ndarray
    part_points: np.ndarray
    obstacle_points: np.ndarray
    ground_height: float | None
    part_clearance: float

    def __post_init__(self) -> None:
        center = self.object_points.mean(axis=0)
        radius = np.linalg.norm(self.object_points - center, axis=1).max()
        reach = radius + _APPROACH_LENGTH + np.linalg.norm(GRIPPER.hand_size)
        near = np.linalg.norm(self.obstacle_points - center, axis=1) < reach
        if self.ground_height is not None:
            near &= self.obstacle_points[:, 2] > self.ground_height + _GROUND_CLEARANCE
        self.obstacle_points = self.obstacle_points[near]

    def is_clear(self, X_WG: np.ndarray, opening: float) -> bool:
        """Returns whether the open gripper is free of collisions at a grasp and on its approach.

        Args:
            X_WG: (4, 4) gripper pose at the grasp [m, world].
            opening: Distance between the pads [m].
        """
        boxes = zip(GRIPPER.finger_boxes(opening), GRIPPER.hand_box(), strict=True)
        lower, upper = (np.vstack(corners) for corners in boxes)
        if self.ground_height is not None:
            corners = np.where(X_WG[2, :3] < 0.0, upper, lower)  # The lowest corner of each box.
            lowest = (corners @ X_WG[2, :3]).min() + X_WG[2, 3]
            if lowest <= self.ground_height + _GROUND_CLEARANCE:
                return False
        X_GW = inverse(X_WG)
        swept = lower.copy()
        swept[:, 2] -= _APPROACH_LENGTH
        for points in (self.object_points, self.obstacle_points):
            points_G = transform_points(X_GW, points)
            if _count_inside(points_G, swept, upper) > _MAX_STRAY_POINTS:
                return False
        if len(self.part_points):
            part_G = transform_points(X_GW, self.part_points)
            # While closing, the fingers sweep the space between them.
            distance = _distance_to_boxes(part_G, *_with_closing_space(lower, upper))
            return distance >= self.part_clearance
        return True


def _with_closing_space(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners of the boxes, and of a box that fills the space between the fingers."""
    space_lower, space_upper = lower[0].copy(), upper[0].copy()
    space_lower[1], space_upper[1] = upper[2, 1], lower[0, 1]
    return np.vstack([lower, space_lower]), np.vstack([upper, space_upper])


def _count_inside(points: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> int:
    # Most points lie outside the box around all boxes.
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
