"""The arm's motions to a grasp: a collision-free path to the pre-grasp, then a straight line."""

import numpy as np

from poil_drake.grasping.approach import plan_joint_path
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.rehearsal.feasibility import STRAIGHT_SPEED
from poil_drake.grasping.rehearsal.path_following import back_off
from poil_drake.grasping.workspace_check import WorkspaceCheck
from poil_drake.planning.joint_timing import time_joint_path
from poil_drake.robots.collision import RobotCollisionChecker
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda_kinematics import PandaModel

_DESCENT_STEP = 0.005  # [m] Between the samples of the straight motion.


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
