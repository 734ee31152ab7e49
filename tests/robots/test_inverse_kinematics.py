import numpy as np
from numpy.testing import assert_allclose

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp
from poil_drake.robots.inverse_kinematics import (
    DISTINCT,
    POSITION_TOLERANCE,
    ROTATION_TOLERANCE,
    InverseKinematicsConfig,
    distinct_solutions,
    solve_inverse_kinematics,
)
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel

DOWN = np.diag([1.0, -1.0, -1.0])


def grasp_poses() -> np.ndarray:
    """Gripper poses over the table, from above, turned and tilted."""
    rng = np.random.default_rng(5)
    poses = []
    for _ in range(20):
        turn = rotation_exp([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        tilt = rotation_exp(np.append(rng.uniform(-0.3, 0.3, 2), 0.0))
        place = [rng.uniform(0.38, 0.55), rng.uniform(-0.25, 0.25), rng.uniform(0.05, 0.3)]
        poses.append(make_transform(tilt @ turn @ DOWN, place))
    return np.array(poses)


def test_every_grasp_pose_over_the_table_has_a_solution(model: PandaModel):
    poses = grasp_poses()

    q, owner = distinct_solutions(model, poses)

    assert set(owner) == set(range(len(poses)))
    X = model.gripper_pose(q)
    assert_allclose(X[:, :3, 3], poses[owner, :3, 3], atol=POSITION_TOLERANCE)
    assert_allclose(X[:, :3, :3], poses[owner, :3, :3], atol=ROTATION_TOLERANCE)
    assert np.all(model.limit_margin(q) >= InverseKinematicsConfig().limit_margin - 1e-12)


def test_a_robot_in_another_place_finds_the_same_solutions(model: PandaModel):
    X_WB = make_transform(rotation_exp([0.0, 0.0, 2.5]), [-0.4, 0.7, 0.3])
    poses = grasp_poses()[:4]
    expected, _ = distinct_solutions(model, poses)

    q, _ = distinct_solutions(PandaModel(X_WB=X_WB), X_WB @ poses)

    assert_allclose(q, expected, atol=1e-6)


def test_solutions_for_one_pose_differ(model: PandaModel):
    q, owner = distinct_solutions(model, grasp_poses()[:3])

    for pose in range(3):
        own = q[owner == pose]
        gaps = np.abs(own[:, None] - own[None]).max(axis=-1) + np.eye(len(own))
        assert gaps.min() > DISTINCT


def test_pose_out_of_reach_is_not_reached(model: PandaModel):
    far = make_transform(DOWN, [1.5, 0.0, 0.1])[None]

    q, reached = solve_inverse_kinematics(model, far, NOMINAL_POSTURE[None])

    assert not reached[0]
    assert np.all(model.limit_margin(q) >= 0.0)
