import numpy as np
import pytest

from poil_drake.geometry.pca_normals import pca_normals as dut


@pytest.mark.parametrize("side", [5.0, -5.0])
def test_normals_of_a_plane_face_the_camera(side):
    rng = np.random.default_rng(0)
    normal = np.array([0.6, 0.0, 0.8])
    points = rng.uniform(-1.0, 1.0, size=(80, 3))
    points -= np.outer(points @ normal - side, normal)

    normals = dut(points, np.arange(80))

    np.testing.assert_allclose(normals, np.tile(-np.sign(side) * normal, (80, 1)), atol=1e-9)


def test_normals_of_chosen_points_equal_those_among_all():
    points = np.random.default_rng(1).normal(size=(40, 3)) + 9.0

    np.testing.assert_array_equal(dut(points, [3, 17]), dut(points, np.arange(40))[[3, 17]])
