import numpy as np

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.perception.trackers.rigid_flow.config import GrowthConfig
from poil_drake.perception.trackers.rigid_flow.model_growth import (
    Keyframe,
    make_reference_views,
    needs_keyframe,
)

CLEARANCE = 0.008


def allowed(mug_scene, points_M, X_WM):
    """Whether both cameras of the first frame let points of the mug's frame join it."""
    shot = mug_scene.shoot(mug_scene.start)
    reference_views = make_reference_views(shot.frame, shot.masks, mug_scene.start)
    points_W = transform_points(X_WM, points_M)
    return np.all([w.allows(points_M, points_W, CLEARANCE) for w in reference_views], axis=0)


LIFTED = make_transform(rotation_exp(np.array([0.0, 0.5, 0.0])), np.array([0.42, 0.05, 0.25]))


def test_hidden_sides_of_the_object_may_join(mug_scene):
    # The foot, and the back of the wall: both cameras stand in front.
    points = np.array([[0.0, 0.0, 0.0], [0.02, 0.01, 0.0], [-0.04, 0.0, 0.03]])

    assert np.all(allowed(mug_scene, points, LIFTED))


def test_what_would_have_stood_in_empty_space_may_not(mug_scene):
    # Above the rim, before the wall, in the handle's opening.
    points = np.array([[0.038, 0.0, 0.13], [0.07, 0.05, 0.06], [0.05, 0.0, 0.05]])

    assert not np.any(allowed(mug_scene, points, LIFTED))


def test_the_table_beside_the_mug_may_not(mug_scene):
    # It moves with the mug by mistake, or it stays where it is.
    points = np.array([[0.06, 0.0, 0.0]])
    here = mug_scene.start

    assert not np.any(allowed(mug_scene, points, LIFTED))
    assert not np.any(allowed(mug_scene, points, here))


def test_background_that_stays_may_not_join_from_behind_the_mug(mug_scene):
    # Now under the lifted mug's foot, where it was hidden by the mug; on the table all the time.
    table_W = np.array([[0.52, 0.1, 0.0]])
    foot_M = transform_points(np.linalg.inv(LIFTED), table_W)

    assert not np.any(allowed(mug_scene, foot_M, LIFTED))


def test_a_lesson_is_needed_after_a_turn_or_a_journey():
    config = GrowthConfig(rotation=np.radians(10.0), travel=0.03)
    first = Keyframe.at(np.array([1.0, 0.0, 0.0]), np.eye(4))

    def keyframe(degrees, distance):
        a = np.radians(degrees)
        X_WO = make_transform(np.eye(3), np.array([0.0, distance, 0.0]))
        return Keyframe.at(np.array([np.cos(a), np.sin(a), 0.0]), X_WO)

    assert not needs_keyframe(keyframe(9.0, 0.02), (first,), config)
    assert needs_keyframe(keyframe(11.0, 0.0), (first,), config)
    assert needs_keyframe(keyframe(0.0, 0.04), (first,), config)
    assert not needs_keyframe(keyframe(11.0, 0.0), (first, keyframe(12.0, 0.0)), config)
