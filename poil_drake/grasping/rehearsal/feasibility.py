"""What makes a grasp feasible, and one feasible grasp better than another."""

import enum
import math
from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.grasping.rehearsal.path_following import PathFollowingConfig
from poil_drake.robots.collision import CollisionConfig
from poil_drake.robots.inverse_kinematics import InverseKinematicsConfig
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_spheres import RobotSpheresConfig
from poil_drake.robots.posture_guard import PostureGuardConfig


class Failure(enum.Enum):
    """Why a grasp is not feasible; the value completes "n grasps ..."."""

    OUT_OF_REACH = "are out of the arm's reach"
    APPROACH = "cannot be approached along a straight line"
    PATH = "leave the arm's reach or joint limits on the way to the goal"
    RETREAT = "cannot be left at the goal along a straight line"
    SINGULAR = "pass too near a singularity"
    WORKSPACE = "come too near to a face of the box that the arm may be in"
    ROBOT_COLLISION = "bring the robot into collision"
    OBJECT_COLLISION = "bring the object into collision with the scene"
    NOT_CONVERGED = "do not bring the part to the end of its reference"


@dataclass(frozen=True, kw_only=True)
class FeasibilityConfig:
    """What is checked, and what makes one feasible grasp better than another.

    Attributes:
        inverse_kinematics: Search of the configurations at the grasp.
        following: How the arm follows the path.
        collision: Margins.
        spheres: How finely the robot's shape is covered.
        posture: Where the arm may be: the boxes of what will watch over it. None: anywhere.
        workspace_margin: Distance from the boxes' faces that is rehearsed with [m], as the arm
            will not move exactly so.
        nominal_posture: (7,) posture that the redundancy is used for [rad].
        pregrasp_distance: Straight way of the gripper to the grasp [m].
        retreat_distance: Straight way of the gripper away from the released object [m].
        straight_steps: Samples on each straight way.
        straight_speed: Speed on the straight ways [m/s].
        smallest_singular_value: Of the Jacobian, with rotations scaled as in `following`; below
            this a gripper speed of 0.1 m/s asks for joint speeds of several rad/s.
        comfortable_limit_margin: Distance from the joint limits beyond which more is no better
            [rad].
        comfortable_clearance: The same for the robot's clearance [m].
        comfortable_singular_value: The same for the smallest singular value.
        object_contact: The object counts as colliding where it comes nearer to the scene than it
            may by more than this [m]; less only costs. Two clouds of one point each 3-5 mm come
            to within about 2 mm of each other where their surfaces cut.
        travel_scale: Joint travel that costs as much as the joint limits at their worst [rad].
        speed_scale: Fraction of the joint speed limits that may be used without slowing down.
        weights: Weights of joint limits, clearance, singularity, travel, slow-down, the object's
            clearance, and the grasp's score.
    """

    inverse_kinematics: InverseKinematicsConfig = field(default_factory=InverseKinematicsConfig)
    following: PathFollowingConfig = field(default_factory=PathFollowingConfig)
    collision: CollisionConfig = field(default_factory=CollisionConfig)
    spheres: RobotSpheresConfig = field(default_factory=RobotSpheresConfig)
    posture: PostureGuardConfig | None = None
    workspace_margin: float = 0.02
    nominal_posture: tuple[float, ...] = tuple(float(v) for v in NOMINAL_POSTURE)
    pregrasp_distance: float = 0.10
    retreat_distance: float = 0.10
    straight_steps: int = 6
    straight_speed: float = 0.1
    smallest_singular_value: float = 0.01
    comfortable_limit_margin: float = 0.35
    comfortable_clearance: float = 0.04
    comfortable_singular_value: float = 0.05
    object_contact: float = 0.003
    travel_scale: float = 12.0
    speed_scale: float = 0.8
    weights: tuple[float, ...] = (1.0, 1.0, 0.5, 1.0, 0.5, 1.0, 1.0)

    def __post_init__(self) -> None:
        if not 0.0 <= self.workspace_margin < math.inf:
            raise InvalidValueError(
                f"FeasibilityConfig.workspace_margin is {self.workspace_margin} m.",
                remedy="It must be finite, and not negative.",
            )

    def cost(
        self,
        *,
        limit_margin: float,
        clearance: float,
        singular_value: float,
        travel: float,
        speed_ratio: float,
        object_excess: float,
        score: float,
    ) -> float:
        """Returns the weighted sum of what speaks against a feasible grasp.

        Args:
            limit_margin: Smallest distance to a joint limit [rad].
            clearance: Smallest clearance of the robot [m].
            singular_value: Smallest singular value of the Jacobian.
            travel: Sum of all joints' travel while carrying [rad].
            speed_ratio: Largest joint speed over its limit.
            object_excess: How much nearer than it may the object comes to the scene [m].
            score: The grasp's own quality, in [0, 1].
        """
        terms = [
            max(0.0, 1.0 - limit_margin / self.comfortable_limit_margin),
            max(0.0, 1.0 - clearance / self.comfortable_clearance),
            max(0.0, 1.0 - singular_value / self.comfortable_singular_value),
            travel / self.travel_scale,
            max(0.0, speed_ratio / self.speed_scale - 1.0),
            object_excess / self.object_contact,
            1.0 - score,
        ]
        return float(np.dot(self.weights, terms))


@dataclass(frozen=True, eq=False)
class Feasibility(SharedOnCopy):
    """What the rehearsal of one grasp from one arm configuration found.

    Attributes:
        candidate: Index of the grasp.
        q_approach: (A, 7) configurations from the pre-grasp to the grasp [rad].
        q_carry: (S, 7) configurations at the object path's samples [rad].
        q_retreat: (R, 7) configurations from the goal to the end of the retreat [rad].
        limit_margin: Smallest distance to a joint limit on the way [rad].
        singular_value: Smallest singular value of the Jacobian while carrying.
        speed_ratio: Largest joint speed over its limit, at the object's foreseen speed.
        clearance: Smallest clearance of the robot [m]; NaN where the arm cannot follow anyway.
        failure: Why it is not feasible, or None.
        cost: Smaller is better; infinite where not feasible.
        workspace_clearance: How far the arm stays inside its boxes [m]; NaN where there are none,
            or the arm cannot follow anyway.
        tightest_face: Which of their faces stands in the way, a clause; empty where none does.
    """

    candidate: int
    q_approach: np.ndarray
    q_carry: np.ndarray
    q_retreat: np.ndarray
    limit_margin: float
    singular_value: float
    speed_ratio: float
    clearance: float
    failure: Failure | None
    cost: float
    workspace_clearance: float = math.nan
    tightest_face: str = ""

    def __post_init__(self) -> None:
        for name in ("q_approach", "q_carry", "q_retreat"):
            array = frozen_array(getattr(self, name), name=f"Feasibility.{name}", shape=("T", 7))
            object.__setattr__(self, name, array)
