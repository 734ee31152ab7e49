from dataclasses import replace

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_exp,
    transform_points,
)
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.model_growth import (
    Keyframe,
    grow_model,
    needs_keyframe,
)
from poil_drake.perception.trackers.rigid_flow.view_window import make_window

LIFTED = make_transform(rotation_exp(np.array([0.0, 0.5, 0.0])), np.array([0.42, 0.05, 0.25]))
UNDER_THE_FOOT = transform_points(np.linalg.inv(LIFTED), np.array([[0.52, 0.1, 0.0]]))


@pytest.mark.parametrize(
    ("points_M", "X_WM", "allowed"),
    [
        # The foot, and the back of the wall: both cameras are in front.
        ([[0.0, 0.0, 0.0], [0.02, 0.01, 0.0], [-0.04, 0.0, 0.03]], LIFTED, True),
        # Above the rim, in front of the wall, in the handle's opening.
        ([[0.038, 0.0, 0.13], [0.07, 0.05, 0.06], [0.05, 0.0, 0.05]], LIFTED, False),
        ([[0.06, 0.0, 0.0]], LIFTED, False),
        ([[0.06, 0.0, 0.0]], None, False),
        (UNDER_THE_FOOT, LIFTED, False),
    ],
    ids=["hidden sides", "free space", "table that moves", "table that stays", "table hidden"],
)
def test_only_hidden_points_may_join(built_mug, mug_scene, points_M, X_WM, allowed):
    points_O = transform_points(np.linalg.inv(built_mug.X_WO) @ mug_scene.start, np.array(points_M))
    points_W = transform_points(mug_scene.start if X_WM is None else X_WM, np.array(points_M))

    views = built_mug.model.appearance.reference_views
    found = np.all([view.allows(points_O, points_W) for view in views], axis=0)

    np.testing.assert_array_equal(found, allowed)


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


@pytest.mark.parametrize("count", [3000, 7500, 12000])
def test_a_model_of_any_size_grows_and_keeps_its_points(built_mug, mug_scene, count):
    model = built_mug.model
    rows = np.arange(count) % len(model.surface)
    model = replace(model, surface=model.surface.select(rows))
    turned = mug_scene.start @ make_transform(rotation_exp(np.array([0.0, 0.0, 1.0])), np.zeros(3))
    frame = mug_scene.shoot(turned).frame
    X_WO = turned @ inverse(mug_scene.start) @ built_mug.X_WO
    points_W = transform_points(X_WO, model.surface.points)
    pairs = zip(frame.cameras, frame.images, strict=True)
    windows = [make_window(camera, image, points_W) for camera, image in pairs]

    dut = grow_model(model, windows, X_WO, RigidFlowConfig()).surface

    np.testing.assert_array_equal(dut.points[:count], model.surface.points)
    assert len(dut) > count
    assert {len(rows) for rows in vars(dut).values()} == {len(dut)}
