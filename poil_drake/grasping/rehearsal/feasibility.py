"""Feasibility of grasps: the requirements, and the findings of a rehearsal."""

import enum
import math
from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.robots.collision import CollisionConfig
from poil_drake.robots.posture_guard import PostureGuardConfig

STRAIGHT_SPEED = 0.1
"""Speed of the gripper's straight motions to the grasp and away from the released object [m/s]."""


class Failure(enum.Enum):
    """Why a grasp is not feasible; the value completes a sentence that begins with "n grasps"."""

    OUT_OF_REACH = "are out of the arm's reach"
    APPROACH = "cannot be approached along a straight line"
    PATH = "leave the arm's reach or joint limits on the way to the goal"
    RETREAT = "do not allow a straight retreat at the goal"
    SINGULAR = "pass too close to a singularity"
    WORKSPACE = "come too close to a face of the workspace box"
    ROBOT_COLLISION = "bring the robot into collision"
    OBJECT_COLLISION = "bring the object into collision with the scene"
    NOT_CONVERGED = "do not bring the part to the end of its reference"


@dataclass(frozen=True, kw_only=True)
class FeasibilityConfig:
    """Requirements on a feasible grasp.

    Attributes:
        collision: Margins of the collision checks.
        posture: The workspace boxes in which the supervisor keeps the arm; None for no boxes.
        workspace_margin: Distance that plans keep from the faces of the boxes [m], because the arm
            does not follow plans exactly.
        pregrasp_distance: Length of the gripper's straight motion to the grasp [m].
        retreat_distance: Length of the gripper's straight motion away from the released object [m].
    """

    collision: CollisionConfig = field(default_factory=CollisionConfig)
    posture: PostureGuardConfig | None = None
    workspace_margin: float = 0.02
    pregrasp_distance: float = 0.10
    retreat_distance: float = 0.10

    def __post_init__(self) -> None:
        if not 0.0 <= self.workspace_margin < math.inf:
            raise InvalidValueError(
                f"FeasibilityConfig.workspace_margin is {self.workspace_margin} m.",
                remedy="Pass a finite, non-negative distance.",
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class Feasibility:
    """Result of rehearsing one grasp with one arm configuration at the grasp.

    Attributes:
        candidate: Index of the grasp among the rehearsed candidates.
        q_approach: (A, 7) configurations from the pre-grasp to the grasp [rad].
        q_carry: (S, 7) configurations at the samples of the object's path [rad].
        q_retreat: (R, 7) configurations from the goal to the end of the retreat [rad].
        limit_margin: Smallest distance to a joint limit [rad].
        singular_value: Smallest singular value of the Jacobian while carrying the object; see
            `manipulability`.
        clearance: Smallest clearance of the robot [m]; NaN if an earlier check failed.
        failure: Why the grasp is not feasible; None if it is feasible.
        cost: Smaller is better; infinite if the grasp is not feasible.
        workspace_clearance: The arm's smallest distance from the faces of its workspace boxes [m],
            negative outside; NaN without boxes, or if an earlier check failed.
        tightest_face: A clause that names the face that the arm comes too close to; empty unless
            the failure is `WORKSPACE`.
    """

    candidate: int
    q_approach: np.ndarray
    q_carry: np.ndarray
    q_retreat: np.ndarray
    limit_margin: float
    singular_value: float
    clearance: float
    failure: Failure | None
    cost: float
    workspace_clearance: float
    tightest_face: str
