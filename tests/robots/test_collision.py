import numpy as np
import pytest
from numpy.testing import assert_allclose

from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.robots.collision import (
    CollisionConfig,
    RobotCollisionChecker,
    SceneCloud,
    cloud_clearance,
)
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import RobotSpheres, make_robot_spheres

NO_TABLE = CollisionConfig(ground_height=None)


@pytest.fixture(scope="module")
def spheres(model: PandaModel) -> RobotSpheres:
    return make_robot_spheres(finger_opening=0.03)


def wall(y: float) -> np.ndarray:
    """A wall across the workspace at a given y [m]."""
    x, z = np.meshgrid(np.arange(0.35, 0.8, 0.01), np.arange(0.02, 0.7, 0.01))
    return np.stack([x.ravel(), np.full(x.size, y), z.ravel()], axis=1)


def test_distance_to_a_point_and_to_the_table():
    dut = SceneCloud(np.array([[0.0, 0.0, 0.30]]), config=CollisionConfig(max_distance=1.0))

    distance = dut.distance(np.array([[0.0, 0.03, 0.34], [0.0, 0.0, 0.02], [0.0, 0.0, -0.01]]))

    assert_allclose(distance, [0.05, 0.02, -0.01], atol=1e-12)


@pytest.mark.parametrize("points", [np.array([[1.0, 0.0, 0.30]]), np.zeros((0, 3))])
def test_distance_is_capped(points: np.ndarray):
    dut = SceneCloud(points, config=NO_TABLE)

    assert_allclose(dut.distance(np.zeros((2, 3))), NO_TABLE.max_distance)


def test_points_of_the_table_are_left_to_the_plane():
    dut = SceneCloud(np.array([[0.5, 0.0, 0.003], [0.5, 0.0, 0.1]]))

    assert_allclose(dut.points, [[0.5, 0.0, 0.1]])


def test_clearance_is_the_distance_of_a_point_from_the_nearest_sphere(
    model: PandaModel, spheres: RobotSpheres
):
    poses = model.link_poses(NOMINAL_POSTURE)
    lowest = poses[8, :3, 3] - [0.0, 0.0, 0.1]
    centers = spheres.world_centers(poses)
    moving = spheres.links > 1
    expected = (np.linalg.norm(centers - lowest, axis=1) - spheres.radii)[moving].min()
    config = CollisionConfig(ground_height=None, max_distance=0.2)
    dut = RobotCollisionChecker(
        model=model,
        spheres=spheres,
        scene=SceneCloud(lowest[None], config=config),
        config=config,
    )

    clearance = dut.scene_clearance(poses[None])

    assert_allclose(clearance, expected, atol=1e-12)


def test_path_through_a_wall_is_not_free(model: PandaModel, spheres: RobotSpheres):
    across = np.array(NOMINAL_POSTURE) + np.linspace(-0.6, 0.6, 60)[:, None] * np.eye(7)[0]
    free, dut = (
        RobotCollisionChecker(model=model, spheres=spheres, scene=SceneCloud(wall(y)))
        for y in (-0.9, 0.0)
    )

    assert free.is_free(across).all()
    in_wall = ~dut.is_free(across)
    assert in_wall[30]
    assert not in_wall[[0, -1]].any()
    assert dut.clearance(across)[30] < 0.0


def test_folded_arm_collides_with_itself(model: PandaModel, spheres: RobotSpheres):
    # Elbow closed and wrist turned inwards: the hand is driven into the shoulder.
    folded = np.array([0.0, -1.2, 0.0, -3.0, 0.0, 0.6, 0.8])
    dut = RobotCollisionChecker(model=model, spheres=spheres, scene=SceneCloud(np.zeros((0, 3))))

    clearance = dut.self_clearance(model.link_poses(np.array([NOMINAL_POSTURE, folded])))

    assert clearance[0] > 0.0
    assert clearance[1] < 0.0


def test_points_on_the_robot_are_removed(model: PandaModel, spheres: RobotSpheres):
    poses = model.link_poses(NOMINAL_POSTURE)
    elsewhere = np.array([[0.5, 0.5, 0.5]])
    scene = SceneCloud(np.concatenate([poses[3:, :3, 3], elsewhere]))

    dut = scene.without_robot(spheres, poses, padding=0.02)

    assert_allclose(dut.points, elsewhere)


def test_points_on_the_object_are_removed():
    scene = SceneCloud(np.array([[0.5, 0.0, 0.1], [0.5, 0.0, 0.2]]))

    dut = scene.without_object(np.array([[0.5, 0.005, 0.1]]), padding=0.01)

    assert_allclose(dut.points, [[0.5, 0.0, 0.2]])


def test_clearance_of_a_carried_cloud_follows_its_motion():
    scene = SceneCloud(np.array([[0.5, 0.0, 0.5]]), config=NO_TABLE)
    motion = make_transform(np.eye(3), np.array([[0.0, 0.0, 0.0], [0.0, 0.47, 0.0]]))

    clearance = cloud_clearance(np.array([[0.5, -0.5, 0.5]]), motion, scene)

    assert_allclose(clearance, [[NO_TABLE.max_distance], [0.03]], atol=1e-12)
