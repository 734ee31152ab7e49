import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.pca_normals import pca_normals as dut


def test_normals_of_a_plane_face_the_viewpoint():
    rng = np.random.default_rng(0)
    normal = np.array([0.6, 0.0, 0.8])
    points = rng.uniform(-1.0, 1.0, size=(80, 3))
    points -= np.outer(points @ normal, normal)

    towards = dut(points, viewpoint=5.0 * normal)
    behind = dut(points, viewpoint=-5.0 * normal)

    np.testing.assert_allclose(towards, np.broadcast_to(normal, points.shape), atol=1e-9)
    np.testing.assert_allclose(behind, np.broadcast_to(-normal, points.shape), atol=1e-9)


def test_normals_of_chosen_points_equal_those_among_all():
    points = np.random.default_rng(1).normal(size=(40, 3))

    some = dut(points, viewpoint=np.full(3, 9.0), at=np.array([3, 17]))

    np.testing.assert_array_equal(some, dut(points, viewpoint=np.full(3, 9.0))[[3, 17]])


def test_two_points_are_rejected():
    with pytest.raises(InvalidValueError, match="2 points"):
        dut(np.eye(3)[:2], viewpoint=np.zeros(3))
