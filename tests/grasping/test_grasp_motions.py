import numpy as np
import pytest

from poil_drake.errors import PlanningError
from poil_drake.grasping.approach import ApproachConfig
from poil_drake.grasping.grasp_motions import plan_approach
from poil_drake.grasping.rehearsal.feasibility import FeasibilityConfig
from poil_drake.planning.joint_timing import JointTimingConfig
from poil_drake.robots.collision import SceneCloud
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.posture_guard import PostureGuardConfig

RIGHT, LEFT = (NOMINAL_POSTURE + turn * np.eye(7)[0] for turn in (-0.9, 0.9))
"""Turned aside; the straight way between them turns the stretched arm through the middle."""


def approach(model: PandaModel, **box) -> JointTrajectory:
    return plan_approach(
        model,
        SceneCloud(np.zeros((0, 3))),
        RIGHT,
        LEFT,
        opening=0.04,
        feasibility=FeasibilityConfig(posture=PostureGuardConfig(**box)),
        approach=ApproachConfig(),
        timing=JointTimingConfig(),
        seed=0,
    )


def forward(model: PandaModel, trajectory: JointTrajectory) -> np.ndarray:
    """How far the gripper is in front of the robot (T,) [m]."""
    return model.gripper_pose(trajectory.positions)[:, 0, 3]


def test_a_way_is_searched_within_the_box(model: PandaModel) -> None:
    reach = model.gripper_pose(NOMINAL_POSTURE)[0, 3]
    assert forward(model, approach(model)).max() == pytest.approx(reach, abs=1e-3)

    dut = approach(model, gripper_upper=(reach - 0.05, 0.85, 1.2))

    # Between the postures that are checked the hand goes on by 3 cm, and so off by less than 1 mm.
    kept = FeasibilityConfig().workspace_margin - 0.002
    assert forward(model, dut).max() <= reach - 0.05 - kept + 1e-3
    np.testing.assert_allclose(dut.positions[0], RIGHT, atol=1e-9)
    np.testing.assert_allclose(dut.positions[-1], LEFT, atol=1e-9)


def test_an_arm_near_one_face_keeps_away_from_the_others(model: PandaModel) -> None:
    side, reach = model.gripper_pose(RIGHT)[1, 3], model.gripper_pose(NOMINAL_POSTURE)[0, 3]

    dut = approach(
        model,
        gripper_lower=(-0.85, side - 0.0005, -1.0),
        gripper_upper=(reach - 0.05, 0.85, 1.2),
    )

    kept = FeasibilityConfig().workspace_margin - 0.002
    assert forward(model, dut).max() <= reach - 0.05 - kept + 1e-3
    assert model.gripper_pose(dut.positions)[:, 1, 3].min() >= side - 0.0005


def test_an_arm_outside_the_box_is_told_so(model: PandaModel) -> None:
    side = model.gripper_pose(RIGHT)[1, 3]

    with pytest.raises(PlanningError, match=r"gripper_lower\[1\] is .*, which is passed by 5.0 mm"):
        approach(model, gripper_lower=(-0.85, side + 0.005, -1.0))


def test_an_arm_that_a_face_has_stopped_may_go_back(model: PandaModel) -> None:
    side = model.gripper_pose(RIGHT)[1, 3]

    dut = approach(model, gripper_lower=(-0.85, side + 0.0005, -1.0))

    np.testing.assert_allclose(dut.positions[-1], LEFT, atol=1e-9)


def test_an_end_too_near_to_a_face_is_no_collision(model: PandaModel) -> None:
    side = model.gripper_pose(LEFT)[1, 3]

    with pytest.raises(PlanningError, match=r"end of the approach .*gripper_upper\[1\].* 10.0 mm"):
        approach(model, gripper_upper=(0.85, side + 0.01, 1.2))
