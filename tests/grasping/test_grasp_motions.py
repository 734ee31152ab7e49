from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from point_grids import point_grid

from poil_drake.errors import PlanningError
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping import grasp_motions
from poil_drake.grasping.grasp_motions import WorkspaceCheck, plan_approach, plan_joint_path
from poil_drake.grasping.rehearsal.rehearsal import WORKSPACE_MARGIN, FeasibilityConfig
from poil_drake.planning.path_shortening import EdgeChecker
from poil_drake.robots.collision import RobotCollisionChecker
from poil_drake.robots.inverse_kinematics import distinct_solutions
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.robots.posture_guard import PostureGuardConfig

RIGHT, LEFT = (NOMINAL_POSTURE + turn * np.eye(7)[0] for turn in (-0.9, 0.9))
"""Turned to either side; between them, the straight path swings the arm through the front."""


def checker_against(points: np.ndarray, model: PandaModel) -> RobotCollisionChecker:
    spheres = make_robot_spheres(finger_opening=0.03)
    scene = SceneCloud(points, ground_height=0.0)
    return RobotCollisionChecker(model=model, spheres=spheres, scene=scene)


def approach(model: PandaModel, **box) -> JointTrajectory:
    checker = checker_against(np.zeros((0, 3)), model)
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
    kept = WORKSPACE_MARGIN - 0.002
    assert forward(model, dut).max() <= reach - 0.05 - kept + 1e-3
    assert_allclose(dut.positions[[0, -1]], [RIGHT, LEFT], atol=1e-9)


def test_an_arm_stopped_by_a_face_may_move_back_inside(model: PandaModel) -> None:
    side = model.gripper_pose(RIGHT)[1, 3]

    dut = approach(model, gripper_lower=(-0.85, side + 0.0005, -1.0))

    assert_allclose(dut.positions[-1], LEFT, atol=1e-9)


def test_rejects_an_end_too_close_to_a_face(model: PandaModel) -> None:
    side = model.gripper_pose(LEFT)[1, 3]

    with pytest.raises(
        PlanningError, match=r"end of the approach .* 10.0 mm from .*gripper_upper\[1\]"
    ):
        approach(model, gripper_upper=(0.85, side + 0.01, 1.2))


@pytest.fixture(scope="module")
def checker(model: PandaModel) -> RobotCollisionChecker:
    """A screen 0.45 m high stands between the robot's left and right."""
    screen = point_grid(np.arange(0.25, 0.8, 0.01), 0.0, np.arange(0.02, 0.45, 0.01))
    return checker_against(screen, model)


@pytest.fixture(scope="module")
def ends(model: PandaModel, checker: RobotCollisionChecker) -> tuple[np.ndarray, np.ndarray]:
    """Configurations with the gripper low on either side of the screen."""
    down = np.diag([1.0, -1.0, -1.0])
    found = []
    for side in (0.25, -0.25):
        q, _ = distinct_solutions(model, make_transform(down, [0.45, side, 0.2])[None])
        found.append(q[checker.is_free(q)][0])
    return found[0], found[1]


def test_path_leads_around_an_obstacle(model: PandaModel, checker, ends):
    edges = EdgeChecker(checker.is_free, 0.05)
    assert not edges.is_free(*ends)

    path = plan_joint_path(model, checker.is_free, *ends, seed=0)

    assert_allclose(path[[0, -1]], ends, atol=1e-9)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.06
    dense = np.concatenate([edges.samples(a, b) for a, b in pairwise(path)])
    assert checker.smallest_clearance(dense) > 0.0
    assert model.limit_margin(path).min() > 0.0


def test_same_seed_gives_the_same_path_after_other_searches(model: PandaModel, checker, ends):
    first = plan_joint_path(model, checker.is_free, *ends, seed=7)
    other = plan_joint_path(model, checker.is_free, *ends, seed=8)
    second = plan_joint_path(model, checker.is_free, *ends, seed=7)

    assert_array_equal(first, second)
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_free_space_is_crossed_straight(model: PandaModel):
    goal = NOMINAL_POSTURE + 0.5

    path = plan_joint_path(
        model, lambda q: np.ones(len(q), dtype=bool), NOMINAL_POSTURE, goal, seed=0
    )

    share = (path - NOMINAL_POSTURE) / 0.5
    assert_allclose(share, np.repeat(share[:, :1], 7, axis=1))


@pytest.mark.parametrize(("blocked", "name"), [(0, "start"), (1, "end")])
def test_rejects_an_end_in_collision(model: PandaModel, blocked: int, name: str):
    ends = np.array([NOMINAL_POSTURE, NOMINAL_POSTURE + 0.3])

    def is_free(q: np.ndarray) -> np.ndarray:
        return np.abs(q - ends[blocked]).max(axis=1) > 1e-6

    with pytest.raises(PlanningError, match=f"At the {name} of the approach"):
        plan_joint_path(model, is_free, *ends, seed=0)


def test_search_without_a_solution_ends(model: PandaModel, monkeypatch):
    monkeypatch.setattr(grasp_motions, "_ROUNDS", 50)
    ends = np.array([NOMINAL_POSTURE, NOMINAL_POSTURE + 0.3])

    def only_the_ends(q: np.ndarray) -> np.ndarray:
        return (np.abs(q[:, None] - ends) < 1e-3).all(axis=2).any(axis=1)

    with pytest.raises(PlanningError, match="in 50 rounds"):
        plan_joint_path(model, only_the_ends, *ends, seed=0)
