import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.distance import cdist

from poil_drake.geometry.scene_distance import SceneDistance

GROUND = 0.1


def plate(spacing=0.004):
    """A square plate, 0.4 m wide, upright in the plane x = 0.5."""
    y, z = np.meshgrid(np.arange(-0.2, 0.2, spacing), np.arange(0.2, 0.6, spacing))
    return np.stack([np.full(y.size, 0.5), y.ravel(), z.ravel()], axis=1)


def test_distance_is_that_to_the_nearest_point_up_to_the_reach():
    points = plate(spacing=0.02)
    queries = np.random.default_rng(0).uniform([0.4, -0.3, 0.1], [0.6, 0.3, 0.7], (2, 500, 3))

    distance = SceneDistance(points).distance_to_points(queries, 0.03)

    nearest = cdist(queries.reshape(-1, 3), points).min(axis=1).reshape(2, 500)
    assert_allclose(distance, np.minimum(nearest, 0.03), atol=1e-12)
    assert np.any(distance < 0.03)
    assert np.any(distance == 0.03)


def test_scene_without_points_is_out_of_reach():
    distance = SceneDistance(np.empty((0, 3))).distance_to_points(np.zeros((2, 3, 3)), 0.1)

    assert_array_equal(distance, np.full((2, 3), 0.1))


def test_points_of_the_ground_are_removed():
    flat = np.array([[0.0, 0.0, GROUND + 0.003], [0.1, 0.0, GROUND + 0.02]])

    dut = SceneDistance(flat, ground_height=GROUND)

    assert_array_equal(dut.points, flat[1:])


def test_measured_distance_guarantees_the_clearance_to_the_surface():
    # Above the middle of a cell of 4 mm the nearest sample is 4 / sqrt(2) mm off to the side.
    dut = SceneDistance(plate(spacing=0.004))
    height = 0.003
    above = np.array([[0.5 + height, 0.002, 0.402]])

    distance = float(dut.distance_to_points(above, 0.1)[0])

    assert dut.spacing == pytest.approx(0.004)
    assert dut.measured(height) == pytest.approx(distance)
