import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp
from poil_drake.perception.trackers.rigid_flow.alignment.config import AppearanceConfig
from poil_drake.perception.trackers.rigid_flow.alignment.free_space_term import add_free_space_term
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import NormalEquations
from poil_drake.perception.trackers.rigid_flow.appearance_model import (
    AppearanceModel,
    ObservedPoints,
)

CONFIG = AppearanceConfig(tolerance=0.002)
SPACING, SIZE = 0.002, 80
RADIUS = 0.07


@pytest.fixture(scope="module")
def half_space():
    """A appearance by which all of x > 0 is vacant, in the object's frame."""
    corner = -0.5 * SPACING * SIZE
    x = corner + (np.arange(SIZE) + 0.5) * SPACING
    free_space_depth = np.broadcast_to(np.maximum(x, 0.0)[:, None, None], (SIZE,) * 3)
    return AppearanceModel(
        sureness=np.zeros((1, 1, 1), np.float32),
        free_space_depth=free_space_depth.astype(np.float32).copy(),
        corner=corner,
        spacing=SPACING,
        backgrounds=(),
    )


def added(appearance, points_O, X_WO=None):
    X_WO = np.eye(4) if X_WO is None else X_WO
    points = points_O @ X_WO[:3, :3].T + X_WO[:3, 3]
    equations = NormalEquations()
    around = ObservedPoints(points, np.ones(len(points)))
    add_free_space_term(equations, appearance, around, X_WO, RADIUS, CONFIG)
    return equations


def test_a_point_in_vacant_space_draws_the_object_to_it(half_space):
    # At a cell's middle: 11 mm inside, of which 2 mm are tolerated.
    equations = added(half_space, np.array([[0.011, 0.0, 0.0]]))

    motion = np.linalg.pinv(equations.H) @ equations.b

    np.testing.assert_allclose(motion, [0, 0, 0, 0.009, 0, 0], atol=1e-6)


def test_a_point_beside_the_axis_turns_the_object_round(half_space):
    X_WO = make_transform(rotation_exp(np.array([0.3, -0.8, 0.5])), np.array([0.4, 0.1, 0.2]))
    equations = added(half_space, np.array([[0.011, 0.051, 0.0]]), X_WO)

    turn = equations.b[:3]

    # The half space recedes from a point at +y by a turn about -z.
    assert turn[2] < 0.0
    np.testing.assert_allclose(turn[:2], 0.0, atol=1e-4 * abs(turn[2]))


def test_points_on_the_object_and_far_from_it_do_not_pull(half_space):
    near, tolerated, far = [-0.01, 0.0, 0.0], [0.001, 0.0, 0.0], [0.011, 0.075, 0.0]

    equations = added(half_space, np.array([near, tolerated, far]))

    np.testing.assert_array_equal(equations.b, 0.0)
    np.testing.assert_array_equal(equations.H, 0.0)


def test_another_thing_deep_in_vacant_space_does_not_pull(half_space):
    equations = added(half_space, np.array([[CONFIG.gate + 0.005, 0.0, 0.0]]))

    np.testing.assert_array_equal(equations.b, 0.0)


def test_the_poses_frame_makes_no_difference(half_space):
    points = np.array([[0.011, 0.02, -0.03], [0.007, -0.03, 0.01]])
    X_WO = make_transform(rotation_exp(np.array([0.3, -0.8, 0.5])), np.array([0.4, 0.1, 0.2]))

    here, there = added(half_space, points), added(half_space, points, X_WO)

    assert np.allclose(inverse(X_WO) @ X_WO, np.eye(4))
    np.testing.assert_allclose(there.H, here.H, rtol=1e-6)
