import numpy as np
import pytest

from poil_drake.errors import PlanningError
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.grasp_motions import plan_approach
from poil_drake.grasping.rehearsal.feasibility import FeasibilityConfig
from poil_drake.grasping.workspace_check import WorkspaceCheck
from poil_drake.robots.collision import RobotCollisionChecker
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.robots.posture_guard import PostureGuardConfig

RIGHT, LEFT = (NOMINAL_POSTURE + turn * np.eye(7)[0] for turn in (-0.9, 0.9))
"""Turned to either side; between them, the straight path swings the arm through the front."""


def approach(model: PandaModel, **box) -> JointTrajectory:
    checker = RobotCollisionChecker(
        model=model,
        spheres=make_robot_spheres(finger_opening=0.04),
        scene=SceneCloud(np.zeros((0, 3)), ground_height=0.0),
    )
    boxes = FeasibilityConfig(posture=PostureGuardConfig(**box))
    workspace = WorkspaceCheck(model=model, q_start=RIGHT, feasibility=boxes)
    return plan_approach(model, checker, workspace, RIGHT, LEFT, seed=0)


def forward(model: PandaModel, trajectory: JointTrajectory) -> np.ndarray:
    """The gripper's distance in front of the robot (T,) [m]."""
    return model.gripper_pose(trajectory.positions)[:, 0, 3]


def test_finds_an_approach_inside_the_box(model: PandaModel) -> None:
    reach = model.gripper_pose(NOMINAL_POSTURE)[0, 3]
    assert forward(model, approach(model)).max() == pytest.approx(reach, abs=1e-3)

    dut = approach(model, gripper_upper=(reach - 0.05, 0.85, 1.2))

    # Between checked postures the hand moves by 3 cm, and deviates by less than 1 mm.
    kept = FeasibilityConfig().workspace_margin - 0.002
    assert forward(model, dut).max() <= reach - 0.05 - kept + 1e-3
    np.testing.assert_allclose(dut.positions[[0, -1]], [RIGHT, LEFT], atol=1e-9)


def test_an_arm_stopped_by_a_face_may_move_back_inside(model: PandaModel) -> None:
    side = model.gripper_pose(RIGHT)[1, 3]

    dut = approach(model, gripper_lower=(-0.85, side + 0.0005, -1.0))

    np.testing.assert_allclose(dut.positions[-1], LEFT, atol=1e-9)


def test_rejects_an_end_too_close_to_a_face(model: PandaModel) -> None:
    side = model.gripper_pose(LEFT)[1, 3]

    with pytest.raises(
        PlanningError, match=r"end of the approach .* 10.0 mm from .*gripper_upper\[1\]"
    ):
        approach(model, gripper_upper=(0.85, side + 0.01, 1.2))
