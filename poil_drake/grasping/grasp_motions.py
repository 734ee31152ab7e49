"""The arm's motions to a grasp: a collision-free path to the pre-grasp, then a straight line.

The path is found by RRT-Connect (OMPL), reproducible for a given seed.
"""

import numpy as np

from poil_drake.errors import PlanningError
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.rehearsal.path_following import STRAIGHT_SPEED, back_off
from poil_drake.grasping.rehearsal.rehearsal import WORKSPACE_MARGIN, FeasibilityConfig
from poil_drake.planning.joint_timing import time_joint_path
from poil_drake.planning.path_shortening import EdgeChecker, IsFree, round_corners, shorten_path
from poil_drake.planning.rrt_connect import VectorSpace, rrt_connect
from poil_drake.robots.collision import RobotCollisionChecker
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.posture_guard import PostureGuard

_DESCENT_STEP = 0.005  # [m] Between the samples of the straight motion.

_RESOLUTION = 0.05
"""Distance between the configurations checked along an edge [rad]. In between, the hand is at most
3 cm from its nearest checked position. The collision margin and the robot's spheres, which are
larger than its links, cover most of this distance."""

_ROUNDS = 3000  # Largest number of rounds of tree growth.
_LIMIT_MARGIN = 0.03  # [rad] Distance kept from the joint limits.
_LONGEST_EDGE = 0.6  # [rad] Of the search tree.
_SHORTCUTS = 60  # Attempts to shorten the path.
_SMOOTHING = 0.5  # [rad] Length over which corners are rounded off, where there is space.

_SLACK = 0.002
"""Motions to a rehearsed grasp may fall short of the margin by this much [m]. Their samples, and
therefore their postures, differ slightly from the rehearsed ones."""

_SAG = 0.001
"""The arm may start this far outside its boxes [m], because a stop at a face may leave it there."""

_ROUNDING = 1e-9


class WorkspaceCheck:
    """Checks that motions to a grasp keep a margin to the faces of the workspace boxes.

    If the arm starts closer to a face than the margin, its distance from this face must not shrink.
    """

    def __init__(self, *, model: PandaModel, q_start: np.ndarray, feasibility: FeasibilityConfig):
        """Prepares the check.

        Args:
            model: The arm.
            q_start: (7,) the arm's present configuration [rad].
            feasibility: The boxes.

        Raises:
            PlanningError: The arm is outside its boxes.
        """
        self._guard = PostureGuard(model=model, config=feasibility.posture)
        start = self._guard.face_distances(q_start[None])[0]
        if start.min() < -_SAG:
            raise PlanningError(
                "The arm is outside its workspace box: "
                f"{self._guard.tightest_face(q_start[None])}.",
                remedy="Move the arm into the box, or widen the box (poil.safety.posture).",
            )
        self._least = np.minimum(WORKSPACE_MARGIN - _SLACK, start) - _ROUNDING

    def is_within(self, q: np.ndarray) -> np.ndarray:
        """Returns which configurations (B, 7) [rad] keep the margin: (B,) bool."""
        return (self._guard.face_distances(q) >= self._least).all(axis=1)

    def require(self, q: np.ndarray, what: str) -> None:
        """Raises an error if a motion does not keep the margin.

        Args:
            q: (B, 7) the motion's configurations [rad], B >= 1.
            what: The motion's name, with which the error message begins.

        Raises:
            PlanningError: The motion does not keep the margin; the message names the face.
        """
        within = self.is_within(q)
        if not within.all():
            raise PlanningError(
                f"{what} comes too close to a face of the workspace box: "
                f"{self._guard.tightest_face(q[~within])}.",
                remedy="Widen the box (poil.safety.posture), or move the object away from that "
                "face.",
            )


def plan_descent(
    model: PandaModel, grasp: GraspCandidate, q_grasp: np.ndarray, distance: float
) -> JointTrajectory:
    """Returns the joint motion that takes the gripper straight from the pre-grasp to the grasp.

    Args:
        model: The arm.
        grasp: The grasp.
        q_grasp: (7,) the arm's configuration at the grasp [rad].
        distance: Distance between pre-grasp and grasp [m].
    """
    steps = max(int(np.ceil(distance / _DESCENT_STEP)), 1)
    away = np.linspace(0.0, distance, steps + 1)
    q, _ = back_off(model, q_grasp[None], grasp.X_WG[None], away)
    return time_joint_path(q[0, ::-1], model.velocity, min_duration=distance / STRAIGHT_SPEED)


def plan_approach(
    model: PandaModel,
    checker: RobotCollisionChecker,
    workspace: WorkspaceCheck,
    q_start: np.ndarray,
    q_pregrasp: np.ndarray,
    *,
    seed: int,
) -> JointTrajectory:
    """Returns a collision-free joint motion to the pre-grasp.

    Args:
        model: The arm.
        checker: The collision checker, with the object in its scene.
        workspace: Checks that the arm stays inside its workspace boxes.
        q_start: (7,) the arm's present configuration [rad].
        q_pregrasp: (7,) the configuration at the pre-grasp [rad].
        seed: Seed of the search.

    Raises:
        PlanningError: No path was found, one end of the path is in collision, or the pre-grasp is
            too close to a face of the boxes.
    """
    workspace.require(q_pregrasp[None], "The end of the approach")

    def is_free(q: np.ndarray) -> np.ndarray:
        free = checker.is_free(q)
        free[free] = workspace.is_within(q[free])
        return free

    path = plan_joint_path(model, is_free, q_start, q_pregrasp, seed=seed)
    return time_joint_path(path, model.velocity)


def plan_joint_path(
    model: PandaModel,
    is_free: IsFree,
    q_start: np.ndarray,
    q_goal: np.ndarray,
    *,
    seed: int,
) -> np.ndarray:
    """Returns a smooth, collision-free path (K, 7) [rad] between two configurations.

    The straight path is used if it is free. Otherwise RRT-Connect finds a path, which is then
    shortened and rounded off.

    Args:
        model: The arm, whose joint limits bound the search.
        is_free: Returns which configurations (B, 7) [rad] are free of collisions: (B,) bool.
        q_start: (7,) first configuration [rad].
        q_goal: (7,) last configuration [rad].
        seed: Seed of the search and the shortcuts.

    Raises:
        PlanningError: One end of the path is in collision, or no path was found.
    """
    edges = EdgeChecker(is_free, _RESOLUTION)
    for q, name in ((q_start, "start"), (q_goal, "end")):
        if not is_free(q[None])[0]:
            raise PlanningError(
                f"At the {name} of the approach, q = {np.round(q, 3).tolist()} rad, the robot is "
                "in collision with the scene or with itself.",
                remedy="Clear the space around the robot, and check the cameras' poses.",
            )
    if edges.is_free(q_start, q_goal):
        return edges.samples(q_start, q_goal)
    found = rrt_connect(
        VectorSpace(
            np.minimum(model.lower + _LIMIT_MARGIN, q_start),
            np.maximum(model.upper - _LIMIT_MARGIN, q_start),
        ),
        q_start,
        q_goal,
        is_free=is_free,
        edge_is_free=edges.is_free,
        max_edge=_LONGEST_EDGE,
        iterations=_ROUNDS,
        seed=seed,
    )
    if found is None:
        raise PlanningError(
            f"No collision-free path to the pre-grasp was found in {_ROUNDS} rounds of search.",
            remedy="Clear the space between the arm and the object, or widen the arm's workspace "
            "box (poil.safety.posture).",
        )
    corners = shorten_path(found, edges, _SHORTCUTS, np.random.default_rng(seed))
    return round_corners(corners, edges, width=_SMOOTHING)
