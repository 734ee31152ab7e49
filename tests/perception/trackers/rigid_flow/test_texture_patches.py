import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import make_transform, transform_points
from poil_drake.perception.trackers.rigid_flow.alignment.texture_term import (
    match_patches,
    select_shown,
)
from poil_drake.perception.trackers.rigid_flow.texture_patches import PLANE_REMOVER
from poil_drake.perception.trackers.rigid_flow.view_window import make_window


def test_a_textured_mug_has_patches_and_a_plain_one_none(textured_mug, built_mug):
    assert len(built_mug.model.patches) == 0
    assert len(textured_mug.model.patches) > 40


def test_patches_lie_on_the_mug_and_face_outwards(textured_mug, mug_scene):
    model, X_WO, _ = textured_mug
    X_MO = np.linalg.inv(mug_scene.start) @ X_WO

    points = transform_points(X_MO, model.patches.centres)
    normals = model.patches.normals @ X_MO[:3, :3].T

    # On the walls and the floor, not on rims and handles.
    radius = np.linalg.norm(points[:, :2], axis=1)
    on_wall = np.minimum(np.abs(radius - 0.040), np.abs(radius - 0.036)) < 2e-3
    on_floor = np.abs(points[:, 2] - 0.006) < 2e-3
    assert np.mean(on_wall | on_floor) > 0.9
    # Off the handle, whose flat sides face elsewhere.
    outside = (radius > 0.038) & (points[:, 2] > 0.01) & (np.abs(points[:, 1]) > 0.01)
    outward = np.einsum("pi,pi->p", points[:, :2], normals[:, :2]) / radius
    assert np.all(outward[outside] > 0.9)


def test_only_a_plane_of_grey_is_removed():
    j, i = np.mgrid[-2:3, -2:3]
    texture = np.where((i + j) % 2 == 0, 1.0, -1.0).ravel()
    plane = (40.0 + 3.0 * i - 2.0 * j).ravel()

    np.testing.assert_allclose(plane @ PLANE_REMOVER, 0.0, atol=1e-4)
    np.testing.assert_allclose(
        (texture + plane) @ PLANE_REMOVER, texture @ PLANE_REMOVER, atol=1e-4
    )


@pytest.mark.parametrize("shift", [[0.003, 0.0, 0.0], [0.0, 0.002, -0.003]])
def test_patches_are_found_when_the_prediction_is_off(textured_mug, shift):
    model, X_WO, frame = textured_mug
    predicted = make_transform(np.eye(3), np.array(shift)) @ X_WO
    points_W = transform_points(X_WO, model.surface.points)
    window = make_window(frame.cameras[0], frame.images[0], points_W)

    view = window.at(predicted)
    matches = match_patches(select_shown(model.patches, view), view)

    true_u, true_v = window.at(X_WO).project(matches.centres)
    error = np.hypot(matches.targets[:, 0] - true_u, matches.targets[:, 1] - true_v)
    assert len(error) > 10
    # The search has steps of 1.5 px; a shift of 3 mm is about 2 px.
    assert np.median(error) < 1.2
