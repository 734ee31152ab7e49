"""Rehearses grasps: reach, carry the object along its path, leave it at the goal."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.rehearsal.feasibility import Failure, Feasibility, FeasibilityConfig
from poil_drake.grasping.rehearsal.object_path import ObjectPath
from poil_drake.grasping.rehearsal.path_following import (
    backed_off_poses,
    carried_poses,
    follow_path,
    manipulability,
)
from poil_drake.robots.collision import RobotCollisionChecker, SceneCloud
from poil_drake.robots.inverse_kinematics import distinct_solutions
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.robots.posture_guard import PostureGuard


class FeasibilityChecker:
    """Rehearses grasps with the arm's kinematics against a scene."""

    def __init__(
        self, *, model: PandaModel, scene: SceneCloud, config: FeasibilityConfig | None = None
    ):
        """Prepares the check.

        Args:
            model: The arm.
            scene: What must not be touched, without the object and the robot.
            config: What is checked.
        """
        self._model = model
        self._scene = scene
        self._config = config or FeasibilityConfig()
        self._nominal = np.array(self._config.nominal_posture)
        self._checkers: dict[float | None, RobotCollisionChecker] = {}
        posture = self._config.posture
        self._guard = None if posture is None else PostureGuard(model=model, config=posture)

    def configurations(self, candidates: Sequence[GraspCandidate]) -> tuple[np.ndarray, np.ndarray]:
        """Returns the arm configurations (R, 7) at the grasps [rad] and the grasp (R,) of each."""
        return distinct_solutions(
            self._model,
            np.array([candidate.X_WG for candidate in candidates]),
            nominal=self._nominal,
            config=self._config.inverse_kinematics,
        )

    def rehearse(
        self,
        candidates: Sequence[GraspCandidate],
        configurations: tuple[np.ndarray, np.ndarray],
        path: ObjectPath,
    ) -> list[Feasibility]:
        """Rehearses approach, path and retreat of every grasp from each of its configurations.

        Args:
            candidates: The grasps.
            configurations: What `configurations` returned for them.
            path: The object's foreseen motion.

        Returns:
            One finding for each configuration, in their order.
        """
        q_grasp, owner = configurations
        if not len(q_grasp):
            return []
        ways = self._follow(q_grasp, np.array([candidates[i].X_WG for i in owner]), path)
        return [
            self._judge(int(index), candidates[index], [way.row(row) for way in ways], path)
            for row, index in enumerate(owner)
        ]

    def _follow(self, q_grasp: np.ndarray, X_WG: np.ndarray, path: ObjectPath) -> list["_Way"]:
        """Returns how the arm follows approach, carrying and retreat, for all rows at once."""
        config = self._config
        times = path.times[path.samples]
        ratios = np.linspace(0.0, 1.0, config.straight_steps + 1)
        X_carry = carried_poses(X_WG, path.X_W[path.samples])
        X_back = backed_off_poses(X_WG, ratios * config.pregrasp_distance)
        X_away = backed_off_poses(X_carry[:, -1], ratios * config.retreat_distance)

        def follow(q: np.ndarray, X: np.ndarray, when: np.ndarray) -> _Way:
            return _Way(
                *follow_path(
                    self._model, q, X, when, nominal=self._nominal, config=config.following
                )
            )

        back = follow(q_grasp, X_back, ratios * config.pregrasp_distance / config.straight_speed)
        carry = follow(q_grasp, X_carry, times)
        away = follow(
            carry.q[:, -1], X_away, ratios * config.retreat_distance / config.straight_speed
        )
        return [_Way(back.q[:, ::-1], back.errors[:, ::-1]), carry, away]

    def _judge(
        self, index: int, candidate: GraspCandidate, ways: list["_Way"], path: ObjectPath
    ) -> Feasibility:
        approach, carry, retreat = (way.q for way in ways)
        config = self._config
        singular = float(manipulability(self._model, carry, config.following.rotation_scale).min())
        margin = float(self._model.limit_margin(np.concatenate([approach, carry, retreat])).min())
        speed_ratio = self._speed_ratio(carry, path.times[path.samples])
        failure = self._path_failure(path) or self._kinematic_failure(ways, singular)
        clearance, cost = np.nan, np.inf
        inside, face = np.nan, ""
        if failure is None and self._guard is not None:
            motion = np.concatenate([approach, carry, retreat])
            inside = float(self._guard.face_distances(motion).min())
            if inside < config.workspace_margin:
                failure, face = Failure.WORKSPACE, self._guard.tightest_face(motion)
        if failure is None:
            clearance = self._clearance(candidate, approach, carry, retreat, path)
            if clearance < config.collision.robot_margin:
                failure = Failure.ROBOT_COLLISION
            else:
                cost = config.cost(
                    limit_margin=margin,
                    clearance=clearance,
                    singular_value=singular,
                    travel=float(np.abs(np.diff(carry, axis=0)).sum()),
                    speed_ratio=speed_ratio,
                    object_excess=path.excess,
                    score=candidate.score,
                )
        return Feasibility(
            candidate=index,
            q_approach=approach,
            q_carry=carry,
            q_retreat=retreat,
            limit_margin=margin,
            singular_value=singular,
            speed_ratio=speed_ratio,
            clearance=clearance,
            failure=failure,
            cost=cost,
            workspace_clearance=inside,
            tightest_face=face,
        )

    def _path_failure(self, path: ObjectPath) -> Failure | None:
        if not path.converged:
            return Failure.NOT_CONVERGED
        return Failure.OBJECT_COLLISION if path.excess > self._config.object_contact else None

    def _kinematic_failure(self, ways: list["_Way"], singular: float) -> Failure | None:
        following = self._config.following
        largest = [following.position_tolerance, following.rotation_tolerance]
        reasons = (Failure.APPROACH, Failure.PATH, Failure.RETREAT)
        for way, reason in zip(ways, reasons, strict=True):
            if np.any(way.errors > largest):
                return reason
        return Failure.SINGULAR if singular < self._config.smallest_singular_value else None

    def _clearance(
        self,
        candidate: GraspCandidate,
        approach: np.ndarray,
        carry: np.ndarray,
        retreat: np.ndarray,
        path: ObjectPath,
    ) -> float:
        """Returns the robot's clearance [m]; the sampler has checked the fingers at the grasp."""
        lifted = path.samples >= path.lift_end
        low = self._checker(None).clearance(np.concatenate([approach, carry[~lifted]]))
        open_fingers = self._checker(candidate.pregrasp_width)
        high = open_fingers.clearance(np.concatenate([carry[lifted], retreat]))
        return float(min(low.min(), high.min()))

    def _checker(self, opening: float | None) -> RobotCollisionChecker:
        """Returns the check for a finger opening, rounded up so that few are needed."""
        if opening is not None:
            opening = min(np.ceil(opening / 0.01) * 0.01, self._config.spheres.gripper.max_width)
        if opening not in self._checkers:
            spheres = make_robot_spheres(finger_opening=opening, config=self._config.spheres)
            self._checkers[opening] = RobotCollisionChecker(
                model=self._model,
                spheres=spheres,
                scene=self._scene,
                config=self._config.collision,
            )
        return self._checkers[opening]

    def _speed_ratio(self, q: np.ndarray, times: np.ndarray) -> float:
        speeds = np.abs(np.diff(q, axis=0)) / np.diff(times)[:, None]
        return float((speeds / self._model.velocity).max())


class _Way(NamedTuple):
    """Configurations q (..., T, 7) [rad] along a way and errors (..., T, 2) ([m], [rad])."""

    q: np.ndarray
    errors: np.ndarray

    def row(self, index: int) -> "_Way":
        return _Way(self.q[index], self.errors[index])
