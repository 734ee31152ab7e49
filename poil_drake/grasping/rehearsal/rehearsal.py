"""Rehearses grasps: the approach, the object's motion along its path, the retreat at the goal."""

import enum
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.candidates.grasp_candidate import GRIPPER, GraspCandidate
from poil_drake.grasping.rehearsal.object_path import ObjectPath
from poil_drake.grasping.rehearsal.path_following import (
    POSITION_TOLERANCE,
    ROTATION_TOLERANCE,
    back_off,
    follow_path,
    manipulability,
)
from poil_drake.robots.collision import CollisionConfig, RobotCollisionChecker
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.robots.posture_guard import PostureGuard, PostureGuardConfig

WORKSPACE_MARGIN = 0.02
"""Distance that plans keep from the faces of the workspace boxes [m], because the arm does not
follow plans exactly."""

_STRAIGHT_STEPS = 6  # Samples of each straight motion.

_SMALLEST_SINGULAR_VALUE = 0.01
"""Smallest accepted `manipulability`. Below, 0.1 m/s require joint speeds of several rad/s."""

_OBJECT_CONTACT = 0.004
"""The object collides if it falls short of its required clearance by more than this [m]. A smaller
shortfall only adds cost. Away from the goal 6 mm are required, so a distance below 2 mm is a
collision. Where surfaces intersect, clouds with 3 to 5 mm between their points come this close."""

# Exceeding these margins brings no further advantage.
_COMFORTABLE_LIMIT_MARGIN = 0.35  # [rad] Distance to the joint limits.
_COMFORTABLE_CLEARANCE = 0.04  # [m] Of the robot.
_COMFORTABLE_SINGULAR_VALUE = 0.05
_TRAVEL_SCALE = 12.0  # [rad] Joint travel that costs as much as reaching a joint limit.
_SPEED_SCALE = 0.8  # Fraction of the joint speed limits that can be used without slowing down.
_WEIGHTS = (1.0, 1.0, 0.5, 1.0, 0.5, 1.0, 1.0)  # Of the terms of `_cost`, in their order.


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
        posture: The workspace boxes in which the supervisor keeps the arm.
        pregrasp_distance: Length of the gripper's straight motion to the grasp [m].
        retreat_distance: Length of the gripper's straight motion away from the released object [m].
    """

    collision: CollisionConfig = field(default_factory=CollisionConfig)
    posture: PostureGuardConfig = field(default_factory=PostureGuardConfig)
    pregrasp_distance: float = 0.10
    retreat_distance: float = 0.10


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
            negative outside; NaN if an earlier check failed.
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


class FeasibilityChecker:
    """Rehearses grasps with the arm's kinematics against a scene."""

    def __init__(self, *, model: PandaModel, scene: SceneCloud, config: FeasibilityConfig):
        """Prepares the check.

        Args:
            model: The arm.
            scene: The obstacles, without the object and the robot.
            config: Requirements.
        """
        self._model = model
        self._scene = scene
        self._config = config
        self._checkers: dict[float | None, RobotCollisionChecker] = {}
        self._guard = PostureGuard(model=model, config=config.posture)

    def rehearse(
        self,
        candidates: Sequence[GraspCandidate],
        configurations: tuple[np.ndarray, np.ndarray],
        path: ObjectPath,
    ) -> list[Feasibility]:
        """Rehearses approach, path and retreat of every grasp from each of its configurations.

        Args:
            candidates: The grasps.
            configurations: The result of `distinct_solutions` for these grasps.
            path: The object's predicted motion.

        Returns:
            One finding for each configuration, in their order.
        """
        q_grasp, owner = configurations
        if not len(q_grasp):
            return []
        X_WG = np.array([candidates[i].X_WG for i in owner])
        X_carry = path.X_W[path.samples] @ X_WG[:, None]
        ratios = np.linspace(0.0, 1.0, _STRAIGHT_STEPS + 1)
        pregrasp, retreat = self._config.pregrasp_distance, self._config.retreat_distance
        q_back, back_errors = back_off(self._model, q_grasp, X_WG, ratios * pregrasp)
        q_carry, carry_errors = follow_path(self._model, q_grasp, X_carry, path.times[path.samples])
        q_away, away_errors = back_off(
            self._model, q_carry[:, -1], X_carry[:, -1], ratios * retreat
        )
        missed = [
            (errors > [POSITION_TOLERANCE, ROTATION_TOLERANCE]).any(axis=(1, 2))
            for errors in (back_errors, carry_errors, away_errors)
        ]
        motions = zip(q_back[:, ::-1], q_carry, q_away, strict=True)
        return [
            self._judge(int(index), candidates[index], q, failed, path)
            for index, q, failed in zip(owner, motions, np.transpose(missed), strict=True)
        ]

    def _judge(
        self,
        index: int,
        candidate: GraspCandidate,
        motions: tuple[np.ndarray, ...],
        missed: np.ndarray,
        path: ObjectPath,
    ) -> Feasibility:
        approach, carry, retreat = motions
        everything = np.concatenate([approach, carry, retreat])
        singular_value = float(manipulability(self._model, carry).min())
        limit_margin = float(self._model.limit_margin(everything).min())
        checks = {
            Failure.NOT_CONVERGED: not path.converged,
            Failure.OBJECT_COLLISION: path.excess > _OBJECT_CONTACT,
            Failure.APPROACH: missed[0],
            Failure.PATH: missed[1],
            Failure.RETREAT: missed[2],
            Failure.SINGULAR: singular_value < _SMALLEST_SINGULAR_VALUE,
        }
        failure = next((reason for reason, failed in checks.items() if failed), None)
        clearance, inside, cost, face = np.nan, np.nan, np.inf, ""
        if failure is None:
            inside = float(self._guard.face_distances(everything).min())
            if inside < WORKSPACE_MARGIN:
                failure, face = Failure.WORKSPACE, self._guard.tightest_face(everything)
        if failure is None:
            clearance = self._clearance(candidate, motions, path)
            if clearance < self._config.collision.robot_margin:
                failure = Failure.ROBOT_COLLISION
            else:
                cost = self._cost(candidate, carry, path, limit_margin, clearance, singular_value)
        return Feasibility(
            candidate=index,
            q_approach=approach,
            q_carry=carry,
            q_retreat=retreat,
            limit_margin=limit_margin,
            singular_value=singular_value,
            clearance=clearance,
            failure=failure,
            cost=cost,
            workspace_clearance=inside,
            tightest_face=face,
        )

    def _clearance(
        self, candidate: GraspCandidate, motions: tuple[np.ndarray, ...], path: ObjectPath
    ) -> float:
        """Returns the robot's smallest clearance [m] in `motions`: approach, carry and retreat.

        The fingers count only after the lift, because the sampler has checked them at the grasp.
        """
        approach, carry, retreat = motions
        lifted = path.samples >= path.lift_end
        low = self._checker(None).smallest_clearance(np.concatenate([approach, carry[~lifted]]))
        open_fingers = self._checker(candidate.pregrasp_width)
        return open_fingers.smallest_clearance(np.concatenate([carry[lifted], retreat]), reach=low)

    def _checker(self, opening: float | None) -> RobotCollisionChecker:
        """Returns the collision checker for a finger opening [m]; None leaves out the fingers.

        Openings are rounded up to whole centimetres, which limits the number of checkers.
        """
        if opening is not None:
            opening = min(np.ceil(opening / 0.01) * 0.01, GRIPPER.max_width)
        if opening not in self._checkers:
            self._checkers[opening] = RobotCollisionChecker(
                model=self._model,
                spheres=make_robot_spheres(finger_opening=opening),
                scene=self._scene,
                config=self._config.collision,
            )
        return self._checkers[opening]

    def _cost(
        self,
        candidate: GraspCandidate,
        q_carry: np.ndarray,
        path: ObjectPath,
        limit_margin: float,
        clearance: float,
        singular_value: float,
    ) -> float:
        """Returns the cost of a feasible grasp, a weighted sum of its disadvantages."""
        steps = np.abs(np.diff(q_carry, axis=0))
        speeds = steps / np.diff(path.times[path.samples])[:, None]
        speed_ratio = float((speeds / self._model.velocity).max())
        terms = [
            max(0.0, 1.0 - limit_margin / _COMFORTABLE_LIMIT_MARGIN),
            max(0.0, 1.0 - clearance / _COMFORTABLE_CLEARANCE),
            max(0.0, 1.0 - singular_value / _COMFORTABLE_SINGULAR_VALUE),
            float(steps.sum()) / _TRAVEL_SCALE,
            max(0.0, speed_ratio / _SPEED_SCALE - 1.0),
            path.excess / _OBJECT_CONTACT,
            1.0 - candidate.score,
        ]
        return float(np.dot(_WEIGHTS, terms))
