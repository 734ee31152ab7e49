import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import NormalEquations
from poil_drake.perception.trackers.rigid_flow.free_space import (
    FreeSpaceGrid,
    ObservedPoints,
    add_free_space_term,
)

SPACING, SIZE = 0.002, 80
RADIUS = 0.07
IDENTITY = np.eye(4)
TURNED = make_transform(rotation_exp(np.array([0.3, -0.8, 0.5])), np.array([0.4, 0.1, 0.2]))


@pytest.fixture(scope="module")
def half_space():
    """A grid in which all of x > 0 is free, in the object's frame."""
    corner = -0.5 * SPACING * SIZE
    x = corner + (np.arange(SIZE) + 0.5) * SPACING
    depth = np.broadcast_to(np.maximum(x, 0.0)[:, None, None], (SIZE,) * 3)
    return FreeSpaceGrid(depth.astype(np.float32).copy(), corner, SPACING)


def added(free_space, points_O, X_WO=IDENTITY):
    observed = ObservedPoints(transform_points(X_WO, np.array(points_O)), np.ones(len(points_O)))
    equations = NormalEquations()
    add_free_space_term(equations, free_space, observed, X_WO, RADIUS)
    return equations


def test_a_point_in_free_space_pulls_the_object_to_it(half_space):
    # At a cell's middle: 11 mm deep, of which 2 mm are tolerated.
    equations = added(half_space, [[0.011, 0.0, 0.0]])

    motion = np.linalg.pinv(equations.H) @ equations.b

    np.testing.assert_allclose(motion, [0, 0, 0, 0.009, 0, 0], atol=1e-6)


def test_a_point_beside_the_axis_turns_the_object(half_space):
    turn = added(half_space, [[0.011, 0.051, 0.0]], TURNED).b[:3]

    # The half space recedes from a point at +y by a turn about -z.
    assert turn[2] < 0.0
    np.testing.assert_allclose(turn[:2], 0.0, atol=1e-4 * abs(turn[2]))


@pytest.mark.parametrize(
    "point",
    [[-0.01, 0.0, 0.0], [0.001, 0.0, 0.0], [0.011, 0.075, 0.0], [0.035, 0.0, 0.0]],
    ids=["on the object", "tolerated", "far away", "deep in free space"],
)
def test_other_points_do_not_pull(half_space, point):
    equations = added(half_space, [point])

    np.testing.assert_array_equal(equations.b, 0.0)
    np.testing.assert_array_equal(equations.H, 0.0)


def test_the_result_does_not_depend_on_the_pose(half_space):
    points = [[0.011, 0.02, -0.03], [0.007, -0.03, 0.01]]

    here, there = added(half_space, points), added(half_space, points, TURNED)

    np.testing.assert_allclose(there.H, here.H, rtol=1e-6)
