import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.geometry import point_cloud as dut


def test_cloud_is_read_only_and_checks_shapes():
    cloud = dut.PointCloud(np.zeros((2, 3)))

    assert len(cloud) == 2
    assert not cloud.points.flags.writeable
    with pytest.raises(InvalidValueError, match="normals"):
        dut.PointCloud(np.zeros((2, 3)), np.zeros((3, 3)))


def test_selected_points_keep_normals_and_colors():
    cloud = dut.PointCloud(np.eye(3), -np.eye(3), np.arange(9).reshape(3, 3))

    some = cloud.select(np.array([True, False, True]))

    np.testing.assert_array_equal(some.points, np.eye(3)[[0, 2]])
    np.testing.assert_array_equal(some.normals, -np.eye(3)[[0, 2]])
    assert some.colors.tolist() == [[0, 1, 2], [6, 7, 8]]


def test_voxels_are_averaged_in_lexicographic_order():
    points = np.array([[1.5, 0, 0], [0.2, 0, 0], [0.4, 0.2, 0], [-0.5, 0, 0]])
    colors = np.array([[9, 9, 9], [10, 0, 0], [20, 1, 0], [1, 1, 1]])
    normals = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])

    coarse = dut.voxel_downsample(dut.PointCloud(points, normals, colors), 1.0)

    np.testing.assert_allclose(coarse.points, [[-0.5, 0, 0], [0.3, 0.1, 0], [1.5, 0, 0]])
    assert coarse.colors.tolist() == [[1, 1, 1], [15, 0, 0], [9, 9, 9]]
    np.testing.assert_allclose(coarse.normals[1], [np.sqrt(0.5), np.sqrt(0.5), 0.0])


def test_opposite_normals_in_a_voxel_do_not_cancel():
    cloud = dut.PointCloud(np.full((2, 3), 0.5), np.array([[0, 0, 1.0], [0, 0, -1.0]]))

    assert dut.voxel_downsample(cloud, 1.0).normals.tolist() == [[0.0, 0.0, 1.0]]


def test_empty_cloud_stays_empty():
    assert len(dut.voxel_downsample(dut.PointCloud(np.empty((0, 3))), 0.1)) == 0


def test_lone_point_is_an_outlier():
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
    points = np.vstack([grid, [[30.0, 0.0, 0.0]]])

    inliers = dut.statistical_inliers(points, neighbours=6, deviations=3.0)

    assert inliers.tolist() == [True] * 125 + [False]


def test_too_few_points_have_no_outliers():
    assert dut.statistical_inliers(np.eye(3), neighbours=3, deviations=0.0).all()


def test_points_on_a_line_are_chosen_from_the_outside_in():
    # The centroid is at 2.2, so 5 is the farthest from it; then the other end, then the middle.
    points = np.array([0.0, 1.0, 2.0, 3.0, 5.0])[:, None] * [1.0, 0.0, 0.0]

    assert dut.farthest_point_sampling(points, 3).tolist() == [4, 0, 2]


def test_all_points_can_be_chosen_each_once():
    points = np.random.default_rng(0).normal(size=(12, 3))

    assert sorted(dut.farthest_point_sampling(points, 12)) == list(range(12))


def test_each_choice_is_as_far_as_possible_from_those_before():
    points = np.random.default_rng(1).normal(size=(60, 3))

    chosen = dut.farthest_point_sampling(points, 8)

    for k in range(1, 8):
        before = points[chosen[:k]]
        clearances = np.min(np.linalg.norm(points[:, None] - before, axis=2), axis=1)
        assert clearances[chosen[k]] == pytest.approx(clearances.max())
