import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.geometry.scene_cloud import BodyClearance, SceneCloud

GROUND = 0.1
REACH = 0.012


def plate(spacing=0.004):
    """A square plate, 0.4 m wide, upright in the plane x = 0.5."""
    y, z = np.meshgrid(np.arange(-0.2, 0.2, spacing), np.arange(0.2, 0.6, spacing))
    return np.stack([np.full(y.size, 0.5), y.ravel(), z.ravel()], axis=1)


def test_distance_is_that_to_the_nearest_point_up_to_the_reach():
    points = plate(spacing=0.02)
    queries = np.random.default_rng(0).uniform([0.4, -0.3, 0.1], [0.6, 0.3, 0.7], (2, 500, 3))

    distance = SceneCloud(points).distance_to_points(queries, 0.03)

    nearest = cdist(queries.reshape(-1, 3), points).min(axis=1).reshape(2, 500)
    assert_allclose(distance, np.minimum(nearest, 0.03), atol=1e-12)
    assert np.any(distance < 0.03)
    assert np.any(distance == 0.03)


def test_scene_without_points_is_out_of_reach():
    distance = SceneCloud(np.empty((0, 3))).distance_to_points(np.zeros((2, 3, 3)), 0.1)

    assert_array_equal(distance, np.full((2, 3), 0.1))


@pytest.mark.parametrize(
    ("ground", "expected"), [(GROUND, [0.05, 0.02, -0.01]), (None, [0.05, 0.25, 0.25])]
)
def test_distance_is_to_the_points_or_the_ground_and_negative_below_it(ground, expected):
    dut = SceneCloud(np.array([[0.0, 0.0, GROUND + 0.3]]), ground_height=ground)
    heights = np.array([0.34, 0.02, -0.01])

    distance = dut.distance(
        np.array([0.0, 0.03, GROUND]) + heights[:, None] * [0.0, 0.0, 1.0], 0.25
    )

    assert_allclose(distance, expected, atol=1e-12)


def test_points_of_the_ground_are_removed():
    flat = np.array([[0.0, 0.0, GROUND + 0.003], [0.1, 0.0, GROUND + 0.005], [0.1, 0.0, 0.2]])

    assert_array_equal(SceneCloud(flat, ground_height=GROUND).points, flat[1:])
    thick = SceneCloud(flat, ground_height=GROUND, ground_thickness=0.008)
    assert_array_equal(thick.points, flat[2:])


def test_points_near_others_are_removed():
    dut = SceneCloud(np.array([[0.5, 0.0, 0.1], [0.5, 0.0, 0.2]]))

    assert_allclose(
        dut.without_points(np.array([[0.5, 0.005, 0.1]]), padding=0.01).points, [[0.5, 0.0, 0.2]]
    )


def test_points_in_balls_are_removed():
    dut = SceneCloud(np.array([[0.5, 0.0, 0.1], [0.5, 0.0, 0.2], [0.5, 0.0, 0.3]]))
    centers = np.array([[0.5, 0.05, 0.1], [0.5, 0.05, 0.3]])

    assert_allclose(
        dut.without_balls(centers, np.array([0.06, 0.04])).points,
        [[0.5, 0.0, 0.2], [0.5, 0.0, 0.3]],
    )


def test_a_derived_scene_keeps_the_ground():
    flat = np.array([[0.0, 0.0, GROUND + 0.006], [0.0, 0.0, 0.2]])
    dut = SceneCloud(np.empty((0, 3)), ground_height=GROUND, ground_thickness=0.008)

    more = dut.without_points(flat, 0.1).without_balls(flat, np.ones(2)).with_points(flat)

    assert_array_equal(more.points, flat[1:])
    assert_allclose(more.distance(np.array([[0.0, 0.0, 0.15]]), 1.0), 0.05)


def test_measured_distance_guarantees_the_clearance_to_the_surface():
    # Above the middle of a cell of 4 mm the nearest sample is 4 / sqrt(2) mm off to the side.
    dut = SceneCloud(plate(spacing=0.004))
    height = 0.003
    above = np.array([[0.5 + height, 0.002, 0.402]])

    distance = float(dut.distance_to_points(above, 0.1)[0])

    assert dut.spacing == pytest.approx(0.004)
    assert dut.measured(height) == pytest.approx(distance)


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
