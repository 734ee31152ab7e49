"""The arm's motions to a grasp: a free way to the pre-grasp, then straight ahead."""

import numpy as np

from poil_drake.grasping.approach import ApproachConfig, plan_joint_path
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.rehearsal.feasibility import FeasibilityConfig
from poil_drake.grasping.rehearsal.path_following import backed_off_poses, follow_path
from poil_drake.grasping.workspace_check import WorkspaceCheck
from poil_drake.planning.joint_timing import JointTimingConfig, time_joint_path
from poil_drake.planning.path_shortening import IsFree
from poil_drake.robots.collision import RobotCollisionChecker, SceneCloud
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres


def plan_descent(
    model: PandaModel,
    grasp: GraspCandidate,
    q_grasp: np.ndarray,
    *,
    step: float,
    feasibility: FeasibilityConfig,
    timing: JointTimingConfig,
) -> JointTrajectory:
    """Returns the straight motion of the gripper from the pre-grasp to the grasp.

    Args:
        model: The arm.
        grasp: The grasp.
        q_grasp: (7,) the arm at the grasp [rad].
        step: Distance between the samples of the way [m].
        feasibility: Length and speed of the way, and how it is followed.
        timing: Limits of the joints.
    """
    distance = feasibility.pregrasp_distance
    steps = max(int(np.ceil(distance / step)), 1)
    away = np.linspace(0.0, distance, steps + 1)
    q, _ = follow_path(
        model,
        q_grasp[None],
        backed_off_poses(grasp.X_WG[None], away),
        away / feasibility.straight_speed,
        nominal=np.array(feasibility.nominal_posture),
        config=feasibility.following,
    )
    return time_joint_path(
        q[0, ::-1],
        model.velocity,
        config=timing,
        min_duration=distance / feasibility.straight_speed,
    )


def plan_approach(
    model: PandaModel,
    scene: SceneCloud,
    q_start: np.ndarray,
    q_pregrasp: np.ndarray,
    *,
    opening: float,
    feasibility: FeasibilityConfig,
    approach: ApproachConfig,
    timing: JointTimingConfig,
    seed: int,
) -> JointTrajectory:
    """Returns a free motion from where the arm stands to the pre-grasp.

    Args:
        model: The arm.
        scene: What must not be touched, the object included.
        q_start: (7,) where the arm stands [rad].
        q_pregrasp: (7,) where it shall go [rad].
        opening: Finger opening on the way [m].
        feasibility: The robot's shape, the margins, and the boxes that it may be in.
        approach: Effort of the search.
        timing: Limits of the joints.
        seed: Seed of the search.

    Raises:
        PlanningError: There is no way, or none was found, or one of its ends is where the arm
            may not be.
    """
    checker = RobotCollisionChecker(
        model=model,
        spheres=make_robot_spheres(finger_opening=opening, config=feasibility.spheres),
        scene=scene,
        config=feasibility.collision,
    )
    workspace = WorkspaceCheck.of(model, q_start, feasibility)
    is_free: IsFree = checker.is_free
    if workspace is not None:
        workspace.require(q_pregrasp[None], "The end of the approach")
        is_free = _both(checker.is_free, workspace.is_within)
    path = plan_joint_path(model, is_free, q_start, q_pregrasp, config=approach, seed=seed)
    return time_joint_path(path, model.velocity, config=timing)


def _both(first: IsFree, second: IsFree) -> IsFree:
    def is_free(q: np.ndarray) -> np.ndarray:
        free = first(q)
        free[free] = second(q[free])
        return free

    return is_free
