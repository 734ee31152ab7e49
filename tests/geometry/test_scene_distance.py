import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.scene_distance import SceneDistance, SceneDistanceConfig

GROUND = 0.1


def plate(spacing=0.004):
    """A square plate, 0.4 m wide, upright in the plane x = 0.5."""
    y, z = np.meshgrid(np.arange(-0.2, 0.2, spacing), np.arange(0.2, 0.6, spacing))
    return np.stack([np.full(y.size, 0.5), y.ravel(), z.ravel()], axis=1)


@pytest.fixture(scope="module")
def queries():
    return np.random.default_rng(0).uniform([0.0, -0.5, 0.0], [1.0, 0.5, 1.0], (20_000, 3))


def test_distance_is_that_to_the_nearest_point_or_the_ground(queries):
    dut = SceneDistance(plate(), config=SceneDistanceConfig(ground_height=GROUND))

    distance = dut.distance(queries, 0.03)

    nearest, _ = cKDTree(plate()).query(queries)
    expected = np.minimum(np.minimum(nearest, 0.03), queries[:, 2] - GROUND)
    assert_allclose(distance, expected, atol=1e-12)
    assert np.any(distance < 0.0)
    assert np.any(distance == 0.03)


@pytest.mark.parametrize("max_voxels", [500_000, 2_000])
def test_lower_bound_is_one_and_decides_what_is_far(queries, max_voxels):
    dut = SceneDistance(plate(), config=SceneDistanceConfig(max_voxels=max_voxels))

    bound = dut.lower_bound(queries)

    nearest, _ = cKDTree(plate()).query(queries)
    assert np.all(bound <= nearest + 1e-12)
    assert np.all(bound >= 0.0)
    # Two diagonals of the 8 mm voxels, and no more than the border outside the grid.
    if max_voxels == 500_000:
        assert np.all(bound >= np.minimum(nearest, 0.05) - 2.0 * np.sqrt(3.0) * 0.008)


def test_without_points_there_is_the_ground_alone():
    dut = SceneDistance(np.empty((0, 3)), config=SceneDistanceConfig(ground_height=GROUND))

    distance = dut.distance(np.array([[0.0, 0.0, 0.12], [0.0, 0.0, 0.05], [0, 0, 9.0]]), 0.1)

    assert_allclose(distance, [0.02, -0.05, 0.1], atol=1e-12)


def test_points_of_the_ground_are_left_to_the_plane():
    flat = np.array([[0.0, 0.0, GROUND + 0.003], [0.1, 0.0, GROUND + 0.02]])

    dut = SceneDistance(flat, config=SceneDistanceConfig(ground_height=GROUND))

    assert_array_equal(dut.points, flat[1:])


def test_leading_dimensions_are_kept():
    dut = SceneDistance(plate())

    assert dut.distance(np.zeros((2, 3, 4, 3)), 0.01).shape == (2, 3, 4)


def test_measured_distance_makes_sure_of_the_surface():
    # Above the middle of a cell of 4 mm the nearest sample is 4 / sqrt(2) mm off to the side.
    dut = SceneDistance(plate(spacing=0.004))
    height = 0.003
    above = np.array([[0.5 + height, 0.002, 0.402]])

    distance = float(dut.distance(above, 0.1)[0])

    assert dut.spacing == pytest.approx(0.004)
    assert dut.measured(height) == pytest.approx(distance)


def test_voxels_must_be_positive():
    with pytest.raises(InvalidValueError, match="voxel_size"):
        SceneDistanceConfig(voxel_size=0.0)
