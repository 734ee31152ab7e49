import numpy as np
import pytest
from numpy.testing import assert_allclose

from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.robots.collision import CollisionConfig, RobotCollisionChecker
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import RobotSpheres, make_robot_spheres


@pytest.fixture(scope="module")
def spheres(model: PandaModel) -> RobotSpheres:
    return make_robot_spheres(finger_opening=0.03)


def wall(y: float) -> np.ndarray:
    """A wall across the workspace at a given y [m]."""
    x, z = np.meshgrid(np.arange(0.35, 0.8, 0.01), np.arange(0.02, 0.7, 0.01))
    return np.stack([x.ravel(), np.full(x.size, y), z.ravel()], axis=1)


def test_clearance_is_the_distance_of_a_point_from_the_nearest_sphere(
    model: PandaModel, spheres: RobotSpheres
):
    poses = model.link_poses(NOMINAL_POSTURE)
    lowest = poses[8, :3, 3] - [0.0, 0.0, 0.1]
    centers = spheres.world_centers(poses)
    moving = spheres.links > 1
    expected = (np.linalg.norm(centers - lowest, axis=1) - spheres.radii)[moving].min()
    dut = RobotCollisionChecker(
        model=model,
        spheres=spheres,
        scene=SceneCloud(lowest[None]),
        config=CollisionConfig(max_distance=0.2),
    )

    clearance = dut.scene_clearance(poses[None])

    assert_allclose(clearance, expected, atol=1e-12)


def test_path_through_a_wall_is_not_free(model: PandaModel, spheres: RobotSpheres):
    across = np.array(NOMINAL_POSTURE) + np.linspace(-0.6, 0.6, 60)[:, None] * np.eye(7)[0]
    free, dut = (
        RobotCollisionChecker(
            model=model, spheres=spheres, scene=SceneCloud(wall(y), ground_height=0.0)
        )
        for y in (-0.9, 0.0)
    )

    assert free.is_free(across).all()
    in_wall = ~dut.is_free(across)
    assert in_wall[30]
    assert not in_wall[[0, -1]].any()
    assert dut.smallest_clearance(across[30:31]) < 0.0


def test_folded_arm_collides_with_itself(model: PandaModel, spheres: RobotSpheres):
    # Elbow closed and wrist turned inwards: the hand is driven into the shoulder.
    folded = np.array([0.0, -1.2, 0.0, -3.0, 0.0, 0.6, 0.8])
    dut = RobotCollisionChecker(model=model, spheres=spheres, scene=SceneCloud(np.zeros((0, 3))))

    clearance = dut.self_clearance(model.link_poses(np.array([NOMINAL_POSTURE, folded])))

    assert clearance[0] > 0.0
    assert clearance[1] < 0.0
