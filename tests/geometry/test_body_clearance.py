import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from poil_drake.geometry.body_clearance import BodyClearance
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.geometry.scene_cloud import SceneCloud

REACH = 0.012


@pytest.fixture(scope="module")
def obstacles():
    rng = np.random.default_rng(1)
    rod = np.linspace([0.0, -0.3, 0.3], [0.0, 0.3, 0.3], 301)
    return np.concatenate([rod, rng.uniform([-0.3, -0.3, 0.1], [0.3, 0.3, 0.7], (50, 3))])


@pytest.fixture(scope="module")
def cloud():
    """An ellipsoid's surface."""
    directions = np.random.default_rng(2).normal(size=(1500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return directions * [0.08, 0.05, 0.03]


@pytest.fixture(scope="module")
def poses():
    rng = np.random.default_rng(3)
    turns = rotation_exp(rng.normal(size=(400, 3)))
    return make_transform(turns, rng.uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 0.6], (400, 3)))


@pytest.fixture(scope="module")
def dut(obstacles, cloud):
    return BodyClearance(cloud=cloud, scene=SceneCloud(obstacles))


def test_clearance_is_the_smallest_distance_of_all_pairs(dut, obstacles, cloud, poses):
    clearance = dut.clearance(poses, REACH)

    pairs = cKDTree(obstacles).query(transform_points(poses, cloud))[0].min(axis=1)
    assert_allclose(clearance, np.minimum(pairs, REACH), atol=1e-12)
    assert np.any(pairs < 0.5 * REACH)
    assert np.any(pairs > REACH)


def test_height_is_that_of_the_lowest_point(obstacles, cloud, poses):
    scene = SceneCloud(obstacles, ground_height=0.1)
    dut = BodyClearance(cloud=cloud, scene=scene)

    height = dut.height(poses)

    assert_allclose(height, transform_points(poses, cloud)[..., 2].min(axis=1) - 0.1, atol=1e-12)
    assert np.any(height < 0.0)


def test_without_a_ground_the_height_is_infinite(dut, poses):
    assert np.all(np.isinf(dut.height(poses)))


def test_no_poses_give_no_clearances(dut):
    assert_array_equal(dut.clearance(np.empty((0, 4, 4)), REACH), np.empty(0))


def test_radius_is_that_of_the_farthest_point(dut):
    assert dut.radius == pytest.approx(0.08, rel=0.02)
