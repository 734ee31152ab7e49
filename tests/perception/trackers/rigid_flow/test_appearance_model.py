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
from poil_drake.perception.trackers.rigid_flow.alignment.config import AppearanceConfig
from poil_drake.perception.trackers.rigid_flow.appearance_model import (
    ObservedPoints,
    color_features,
    contradiction,
    learn_appearance,
    likeness,
    observe,
)

RADIUS = 0.1
MIDDLE = make_transform(np.eye(3), np.array([0.0, 0.0, 0.045]))


@pytest.fixture(scope="module")
def appearance(mug_scene):
    shot = mug_scene.shoot(mug_scene.start)
    return learn_appearance(shot.frame, shot.masks, mug_scene.start, RADIUS, AppearanceConfig())


def turned(mug_scene, degrees):
    turn = rotation_exp(np.array([0.0, 0.0, np.radians(degrees)]))
    return mug_scene.start @ make_transform(turn, np.zeros(3))


def test_space_that_a_camera_looked_through_is_vacant(appearance):
    # Above the rim, in the handle's opening, and beside the mug on the cameras' side.
    points = np.array([[0.0, 0.0, 0.125], [0.05, 0.0, 0.05], [0.05, 0.05, 0.05]])

    assert np.all(appearance.free_space_depth_at(tuple(points.T)) > 0.0)


def test_what_the_object_fills_or_hides_is_not_vacant(appearance):
    # In the wall, in the handle, and below the foot.
    points = np.array([[0.038, 0.0, 0.01], [0.067, 0.0, 0.05], [0.0, 0.0, -0.02]])

    np.testing.assert_array_equal(appearance.free_space_depth_at(tuple(points.T)), 0.0)


def test_vacancy_is_the_distance_from_what_may_be_the_object(appearance):
    # 2 cm above the rim's near side; clearance and grid take off up to 8 mm and a cell.
    depth = appearance.free_space_depth_at(tuple(np.array([[0.038, 0.0, 0.115]]).T))

    assert 0.005 < depth[0] < 0.022


def test_observed_points_lie_on_the_object(appearance, mug_scene):
    shot = mug_scene.shoot(mug_scene.start)

    dut = observe(appearance, shot.frame, mug_scene.start[None, :3, 3], 0.15, AppearanceConfig())

    points_M = dut.points - mug_scene.start[:3, 3]
    assert len(dut.points) > 100
    assert np.all(np.linalg.norm(points_M[:, :2], axis=1) < 0.072)
    assert np.all((points_M[:, 2] > -0.001) & (points_M[:, 2] < 0.097))


def test_a_handle_elsewhere_contradicts_the_pose(appearance, mug_scene):
    config = AppearanceConfig()
    shot = mug_scene.shoot(mug_scene.start)
    seen = observe(appearance, shot.frame, mug_scene.start[None, :3, 3], RADIUS, config)
    poses = np.stack([turned(mug_scene, degrees) for degrees in (0.0, 30.0, -90.0)])

    explained, vacant = contradiction(appearance, seen, poses, RADIUS, config)

    share = vacant / (explained + vacant)
    # Less than a fiftieth of the right pose's pixels errs; a handle is a tenth of a mug.
    assert share[0] < 0.02
    assert share[1] > 0.03
    assert share[2] > 0.03


@pytest.mark.parametrize(("nearer", "told"), [(0.0, False), (0.002, False), (0.03, True)])
def test_what_stood_there_from_the_first_tells_nothing(mug_scene, nearer, told):
    shot = mug_scene.shoot(mug_scene.start)
    first, patch = with_a_post(shot)
    appearance = learn_appearance(first, shot.masks, mug_scene.start, RADIUS, AppearanceConfig())
    now, _ = with_a_post(shot, nearer=nearer)

    dut = observe(appearance, now, mug_scene.start[None, :3, 3], 0.15, AppearanceConfig())

    assert patch[pixels(now.cameras[0], dut.points)].any() == told


def test_what_a_camera_that_was_moved_saw_first_is_forgotten(mug_scene):
    shot = mug_scene.shoot(mug_scene.start)
    camera, image = shot.frame.cameras[0], shot.frame.images[0]
    appearance = learn_appearance(
        shot.frame, shot.masks, mug_scene.start, RADIUS, AppearanceConfig()
    )
    aside = dataclasses.replace(
        camera, X_WC=camera.X_WC @ make_transform(np.eye(3), np.array([0.01, 0.0, 0.0]))
    )
    everything = slice(None), slice(None), image.depth, 0.008

    assert appearance.backgrounds[0].shows(camera, *everything).any()
    assert not appearance.backgrounds[0].shows(aside, *everything).any()


@pytest.mark.parametrize(("width", "told"), [(1, False), (2, True)])
def test_depth_that_flies_between_two_surfaces_tells_nothing(appearance, mug_scene, width, told):
    shot = mug_scene.shoot(mug_scene.start)
    flown, patch = with_a_fringe(shot, width)
    every_pixel = AppearanceConfig(looked_at=100_000, observed=100_000)

    dut = observe(appearance, flown, mug_scene.start[None, :3, 3], 0.15, every_pixel)

    assert patch[pixels(flown.cameras[0], dut.points)].any() == told


def pixels(camera, points):
    """Rows and columns in a view of those points that lie in it."""
    points_C = transform_points(inverse(camera.X_WC), points)
    u, v = np.rint((points_C @ camera.K.T)[:, :2] / points_C[:, 2:]).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    return v[inside], u[inside]


def with_a_fringe(shot, width):
    """Paints a line of the mug's colour beside it in the first view, nearer than what is there.

    Every pixel of a line one pixel wide has another depth, those of a wider one have all the same.
    """
    image, mask = shot.frame.images[0], shot.masks[0]
    rows, columns = np.nonzero(mask)
    left = columns.max() + 8
    patch = np.zeros(mask.shape, dtype=bool)
    patch[rows.min() : rows.max(), left : left + width] = True
    rgb, depth = image.rgb.copy(), image.depth.copy()
    rgb[patch] = np.median(image.rgb[mask], axis=0)
    depth[patch] = np.median(image.depth[mask]) - 0.05
    if width == 1:
        depth[rows.min() : rows.max() : 2, left] -= 0.02
    painted = RgbdImage(rgb, depth, image.stamp)
    return dataclasses.replace(shot.frame, images=(painted, *shot.frame.images[1:])), patch


def with_a_post(shot, nearer=0.0):
    """Paints a post of the mug's colour and depth [m] beside it in the first view."""
    image, mask = shot.frame.images[0], shot.masks[0]
    rows, columns = np.nonzero(mask)
    patch = np.zeros(mask.shape, dtype=bool)
    patch[rows.min() : rows.max(), columns.max() + 8 : columns.max() + 14] = True
    rgb, depth = image.rgb.copy(), image.depth.copy()
    rgb[patch] = np.median(image.rgb[mask], axis=0)
    depth[patch] = np.median(image.depth[mask]) - nearer
    painted = RgbdImage(rgb, depth, image.stamp)
    return dataclasses.replace(shot.frame, images=(painted, *shot.frame.images[1:])), patch


def test_what_is_far_from_the_object_says_nothing(appearance, mug_scene):
    far = ObservedPoints(
        transform_points(mug_scene.start, np.array([[0.5, 0.0, 0.0]])).astype(np.float32),
        np.ones(1, np.float32),
    )

    explained, vacant = contradiction(
        appearance, far, mug_scene.start[None], RADIUS, AppearanceConfig()
    )

    assert explained[0] == vacant[0] == 0.0


def test_colours_are_alike_in_light_and_shade_and_others_are_not():
    own = color_features(np.array([[200, 60, 40]] * 3, dtype=np.uint8))
    seen = np.array([[200, 60, 40], [130, 39, 26], [40, 60, 200]], dtype=np.uint8)

    same, shaded, other = likeness(seen, own, AppearanceConfig())

    assert same == 1.0
    assert shaded > 0.5
    assert other == -1.0
