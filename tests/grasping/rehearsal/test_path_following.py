import numpy as np
from numpy.testing import assert_allclose

from poil_drake.grasping.rehearsal.path_following import (
    LIMIT_MARGIN,
    POSITION_TOLERANCE,
    ROTATION_TOLERANCE,
    back_off,
    follow_path,
    manipulability,
)
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel

TIMES = np.linspace(0.0, 2.0, 21)


def straight(model: PandaModel, displacement: list[float]) -> np.ndarray:
    """Returns gripper poses (1, 21, 4, 4) straight from the nominal posture's."""
    X = np.repeat(model.gripper_pose(NOMINAL_POSTURE)[None, None], len(TIMES), axis=1)
    X[..., :3, 3] += np.linspace(0.0, 1.0, len(TIMES))[:, None] * displacement
    return X


def test_straight_path_is_followed_within_the_tolerance(model: PandaModel):
    X = straight(model, [0.15, 0.2, -0.2])

    q, errors = follow_path(model, NOMINAL_POSTURE[None], X, TIMES)

    assert errors[..., 0].max() <= POSITION_TOLERANCE
    assert errors[..., 1].max() <= ROTATION_TOLERANCE
    assert_allclose(model.gripper_pose(q)[..., :3, 3], X[..., :3, 3], atol=1e-3)
    assert model.limit_margin(q).min() >= LIMIT_MARGIN - 1e-12


def test_errors_show_where_the_path_is_out_of_reach(model: PandaModel):
    X = straight(model, [0.8, 0.0, 0.0])

    q, errors = follow_path(model, NOMINAL_POSTURE[None], X, TIMES)

    assert errors[0, 5, 0] < 1e-3
    assert errors[0, -1, 0] > 0.05
    assert model.limit_margin(q).min() >= 0.0


def test_rows_are_independent(model: PandaModel):
    X = np.concatenate([straight(model, [0.1, 0.1, 0.0]), straight(model, [0.8, 0.0, 0.0])])
    start = np.repeat(NOMINAL_POSTURE[None], 2, axis=0)

    both, _ = follow_path(model, start, X, TIMES)
    alone, _ = follow_path(model, start[:1], X[:1], TIMES)

    assert_allclose(both[0], alone[0], atol=1e-9)


def test_stretched_arm_is_singular(model: PandaModel):
    stretched = np.array([0.0, 0.0, 0.0, -0.0001, 0.0, np.pi / 2, 0.0])

    values = manipulability(model, np.array([NOMINAL_POSTURE, stretched]))

    assert values[0] > 0.05
    assert values[1] < 1e-3


def test_backs_off_against_the_approach_direction(model: PandaModel):
    X = model.gripper_pose(NOMINAL_POSTURE)

    q, errors = back_off(model, NOMINAL_POSTURE[None], X[None], np.array([0.0, 0.02, 0.05]))

    assert errors.max() < 1e-3
    moved = model.gripper_pose(q[0]) - X
    assert_allclose(moved[:, :3, 3], np.outer([0.0, -0.02, -0.05], X[:3, 2]), atol=1e-3)
