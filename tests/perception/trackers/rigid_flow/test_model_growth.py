import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.perception.trackers.rigid_flow.model_growth import Keyframe, needs_keyframe


def allowed(mug, scene, points_M, X_WM):
    """Returns whether both reference views allow points of the mug's frame to join."""
    points_O = transform_points(np.linalg.inv(mug.X_WO) @ scene.start, points_M)
    points_W = transform_points(X_WM, points_M)
    views = mug.model.appearance.reference_views
    return np.all([view.allows(points_O, points_W) for view in views], axis=0)


LIFTED = make_transform(rotation_exp(np.array([0.0, 0.5, 0.0])), np.array([0.42, 0.05, 0.25]))


def test_hidden_sides_of_the_object_may_join(built_mug, mug_scene):
    # The foot, and the back of the wall: both cameras are in front.
    points = np.array([[0.0, 0.0, 0.0], [0.02, 0.01, 0.0], [-0.04, 0.0, 0.03]])

    assert np.all(allowed(built_mug, mug_scene, points, LIFTED))


def test_points_that_would_have_been_in_free_space_may_not_join(built_mug, mug_scene):
    # Above the rim, in front of the wall, in the handle's opening.
    points = np.array([[0.038, 0.0, 0.13], [0.07, 0.05, 0.06], [0.05, 0.0, 0.05]])

    assert not np.any(allowed(built_mug, mug_scene, points, LIFTED))


@pytest.mark.parametrize("moves", [True, False])
def test_the_table_beside_the_mug_may_not_join(built_mug, mug_scene, moves):
    points = np.array([[0.06, 0.0, 0.0]])

    assert not np.any(allowed(built_mug, mug_scene, points, LIFTED if moves else mug_scene.start))


def test_background_that_the_mug_hid_may_not_join(built_mug, mug_scene):
    # Now under the lifted mug's foot; on the table all the time.
    table_W = np.array([[0.52, 0.1, 0.0]])
    foot_M = transform_points(np.linalg.inv(LIFTED), table_W)

    assert not np.any(allowed(built_mug, mug_scene, foot_M, LIFTED))


def keyframe(degrees, distance):
    a = np.radians(degrees)
    X_WO = make_transform(np.eye(3), np.array([0.0, distance, 0.0]))
    return Keyframe.at(np.array([np.cos(a), np.sin(a), 0.0]), X_WO)


@pytest.mark.parametrize(
    ("degrees", "distance", "needed"),
    [(9.0, 0.02, False), (11.0, 0.0, True), (0.0, 0.04, True), (19.0, 0.0, False)],
)
def test_a_turn_or_a_motion_needs_a_keyframe(degrees, distance, needed):
    known = (keyframe(0.0, 0.0), keyframe(25.0, 0.0))

    assert needs_keyframe(keyframe(degrees, distance), known) == needed
