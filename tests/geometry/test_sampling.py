import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.sampling import farthest_point_sampling as dut


def test_points_on_a_line_are_chosen_from_the_outside_in():
    # The centroid is at 2.2, so 5 is the farthest from it; then the other end, then the middle.
    points = np.array([0.0, 1.0, 2.0, 3.0, 5.0])[:, None] * [1.0, 0.0, 0.0]

    assert dut(points, 3).tolist() == [4, 0, 2]


def test_all_points_can_be_chosen_each_once():
    points = np.random.default_rng(0).normal(size=(12, 3))

    assert sorted(dut(points, 12)) == list(range(12))


def test_each_choice_is_as_far_as_possible_from_those_before():
    points = np.random.default_rng(1).normal(size=(60, 3))

    chosen = dut(points, 8)

    for k in range(1, 8):
        before = points[chosen[:k]]
        clearances = np.min(np.linalg.norm(points[:, None] - before, axis=2), axis=1)
        assert clearances[chosen[k]] == pytest.approx(clearances.max())


def test_more_points_than_the_cloud_has_are_rejected():
    with pytest.raises(InvalidValueError, match="choose 4 of 3"):
        dut(np.eye(3), 4)
