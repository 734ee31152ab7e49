from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from point_grids import point_grid

from poil_drake.errors import PlanningError
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.approach import plan_joint_path
from poil_drake.planning.path_shortening import EdgeChecker
from poil_drake.robots.collision import RobotCollisionChecker
from poil_drake.robots.inverse_kinematics import distinct_solutions
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import make_robot_spheres


@pytest.fixture(scope="module")
def checker(model: PandaModel) -> RobotCollisionChecker:
    """A screen 0.45 m high stands between the robot's left and right."""
    screen = point_grid(np.arange(0.25, 0.8, 0.01), 0.0, np.arange(0.02, 0.45, 0.01))
    spheres = make_robot_spheres(finger_opening=0.03)
    return RobotCollisionChecker(
        model=model, spheres=spheres, scene=SceneCloud(screen, ground_height=0.0)
    )


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

    path = plan_joint_path(model, checker.is_free, *ends)

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

    path = plan_joint_path(model, lambda q: np.ones(len(q), dtype=bool), NOMINAL_POSTURE, goal)

    share = (path - NOMINAL_POSTURE) / 0.5
    assert_allclose(share, np.repeat(share[:, :1], 7, axis=1))


@pytest.mark.parametrize(("blocked", "name"), [(0, "start"), (1, "end")])
def test_rejects_an_end_in_collision(model: PandaModel, blocked: int, name: str):
    ends = np.array([NOMINAL_POSTURE, NOMINAL_POSTURE + 0.3])

    def is_free(q: np.ndarray) -> np.ndarray:
        return np.abs(q - ends[blocked]).max(axis=1) > 1e-6

    with pytest.raises(PlanningError, match=f"At the {name} of the approach"):
        plan_joint_path(model, is_free, *ends)


def test_search_without_a_solution_ends(model: PandaModel):
    ends = np.array([NOMINAL_POSTURE, NOMINAL_POSTURE + 0.3])

    def only_the_ends(q: np.ndarray) -> np.ndarray:
        return (np.abs(q[:, None] - ends) < 1e-3).all(axis=2).any(axis=1)

    with pytest.raises(PlanningError, match="in 50 rounds"):
        plan_joint_path(model, only_the_ends, *ends, iterations=50)
