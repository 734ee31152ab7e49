import dataclasses

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_exp,
    transform_points,
)
from poil_drake.perception.images import RgbdImage
from poil_drake.perception.trackers.rigid_flow import appearance_model
from poil_drake.perception.trackers.rigid_flow.appearance_model import (
    color_features,
    color_similarity,
    learn_appearance,
    observe,
)
from poil_drake.perception.trackers.rigid_flow.free_space import ObservedPoints
from poil_drake.perception.trackers.rigid_flow.reference_view import make_reference_views

RADIUS = 0.1


def learnt(scene, frame, masks):
    """Returns the appearance of the mug, in the mug's own frame."""
    views = make_reference_views(frame, masks, scene.start)
    return learn_appearance(frame, masks, views, RADIUS)


def observed(appearance, scene, frame, reach=0.15):
    return observe(appearance, frame, scene.start[None, :3, 3], reach)


@pytest.fixture(scope="module")
def shot(mug_scene):
    return mug_scene.shoot(mug_scene.start)


@pytest.fixture(scope="module")
def appearance(mug_scene, shot):
    return learnt(mug_scene, *shot)


@pytest.mark.parametrize(
    ("points", "free"),
    [
        # Above the rim, in the handle's opening, and beside the mug on the cameras' side.
        ([[0.0, 0.0, 0.125], [0.05, 0.0, 0.05], [0.05, 0.05, 0.05]], True),
        # In the wall, in the handle, and below the foot.
        ([[0.038, 0.0, 0.01], [0.067, 0.0, 0.05], [0.0, 0.0, -0.02]], False),
    ],
)
def test_space_is_free_where_a_camera_saw_through_it(appearance, points, free):
    depth = appearance.free_space.depth_at(tuple(np.transpose(points)))

    np.testing.assert_array_equal(depth > 0.0, free)


def test_depth_in_free_space_is_the_distance_from_the_object(appearance):
    # 2 cm above the rim's near side; clearance and grid reduce it by up to 8 mm and a cell.
    depth = appearance.free_space.depth_at(np.array([0.038, 0.0, 0.115]))

    assert 0.005 < depth < 0.022


def test_observed_points_lie_on_the_object(appearance, mug_scene, shot):
    dut = observed(appearance, mug_scene, shot.frame)

    points_M = dut.points - mug_scene.start[:3, 3]
    assert len(dut.points) > 100
    assert np.all(np.linalg.norm(points_M[:, :2], axis=1) < 0.072)
    assert np.all((points_M[:, 2] > -0.001) & (points_M[:, 2] < 0.097))


def test_a_handle_elsewhere_contradicts_the_pose(appearance, mug_scene, shot):
    turns = [rotation_exp(np.array([0.0, 0.0, np.radians(a)])) for a in (0.0, 30.0, -90.0)]
    poses = np.stack([mug_scene.start @ make_transform(turn, np.zeros(3)) for turn in turns])

    explained, conflicting = appearance.free_space.conflict(
        observed(appearance, mug_scene, shot.frame, RADIUS), poses, RADIUS
    )

    share = conflicting / (explained + conflicting)
    # At the true pose less than a fiftieth of the pixels errs; a handle is a tenth of a mug.
    assert share[0] < 0.02
    assert share[1] > 0.03
    assert share[2] > 0.03


@pytest.mark.parametrize(("nearer", "expected"), [(0.0, False), (0.002, False), (0.03, True)])
def test_background_of_the_first_frame_is_not_observed(mug_scene, shot, nearer, expected):
    first, _ = painted(shot, 6)
    now, patch = painted(shot, 6, nearer)

    dut = observed(learnt(mug_scene, first, shot.masks), mug_scene, now)

    assert patch[pixels(now.cameras[0], dut.points)].any() == expected


def test_the_background_of_a_camera_that_moved_is_unknown(appearance, shot):
    camera, image = shot.frame.cameras[0], shot.frame.images[0]
    aside = make_transform(np.eye(3), np.array([0.01, 0.0, 0.0]))
    moved = dataclasses.replace(camera, X_WC=camera.X_WC @ aside)
    everything = slice(None), slice(None), image.depth

    view = appearance.reference_views[0]

    assert view.shows_background(camera, *everything).any()
    assert not view.shows_background(moved, *everything).any()


@pytest.mark.parametrize(("width", "expected"), [(1, False), (2, True)])
def test_depth_that_flies_between_two_surfaces_is_not_observed(
    appearance, mug_scene, shot, width, expected, monkeypatch
):
    # Every pixel of a line one pixel wide has a different depth, those of a wider one the same.
    flown, patch = painted(shot, width, 0.05, jagged=width == 1)
    monkeypatch.setattr(appearance_model, "_INSPECTED", 100_000)
    monkeypatch.setattr(appearance_model, "_MAX_OBSERVED", 100_000)

    dut = observed(appearance, mug_scene, flown)

    assert patch[pixels(flown.cameras[0], dut.points)].any() == expected


def pixels(camera, points):
    """Returns the rows and columns of those points that a camera sees."""
    points_C = transform_points(inverse(camera.X_WC), points)
    u, v = np.rint((points_C @ camera.K.T)[:, :2] / points_C[:, 2:]).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    return v[inside], u[inside]


def painted(shot, width, nearer=0.0, *, jagged=False):
    """Paints a post of the mug's colour beside it in the first view, nearer than the mug [m].

    Returns the frame and the post's pixels. A jagged post has steps of 2 cm from row to row.
    """
    image, mask = shot.frame.images[0], shot.masks[0]
    rows, columns = np.nonzero(mask)
    left = columns.max() + 8
    patch = np.zeros(mask.shape, dtype=bool)
    patch[rows.min() : rows.max(), left : left + width] = True
    rgb, depth = image.rgb.copy(), image.depth.copy()
    rgb[patch] = np.median(image.rgb[mask], axis=0)
    depth[patch] = np.median(image.depth[mask]) - nearer
    if jagged:
        depth[rows.min() : rows.max() : 2, left] -= 0.02
    view = RgbdImage(rgb, depth, image.stamp)
    return dataclasses.replace(shot.frame, images=(view, *shot.frame.images[1:])), patch


def test_points_far_from_the_object_do_not_count(appearance, mug_scene):
    far = transform_points(mug_scene.start, np.array([[0.5, 0.0, 0.0]])).astype(np.float32)

    explained, conflicting = appearance.free_space.conflict(
        ObservedPoints(far, np.ones(1, np.float32)), mug_scene.start[None], RADIUS
    )

    assert explained[0] == conflicting[0] == 0.0


def test_colours_are_similar_in_light_and_shade_and_others_are_not():
    own = color_features(np.array([[200, 60, 40]] * 3, dtype=np.uint8))
    seen = np.array([[200, 60, 40], [130, 39, 26], [40, 60, 200]], dtype=np.uint8)

    same, shaded, other = color_similarity(seen, own)

    assert same == 1.0
    assert shaded > 0.5
    assert other == -1.0
