import numpy as np
import pytest
from entry_scenes import at, rod_scene, shelf_scene, wall_scene
from numpy.testing import assert_allclose

from poil_drake.control.entry.entry_clearance import EntryClearanceConfig
from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.planning.pose_vectors import poses_of, vectors_of

NEARBY = make_transform(rotation_exp([0.2, -0.3, 0.5]), [-0.1, 0.2, 0.3])


@pytest.fixture(scope="module")
def scene():
    return wall_scene()


@pytest.fixture(scope="module")
def model(scene):
    return scene.planner(X_WO=NEARBY).model


def body_cloud(scene, model, X_WB):
    """The object's cloud at poses of the body frame, which had the world's axes at `NEARBY`."""
    seen = transform_points(NEARBY, scene.cloud)
    middle = transform_points(NEARBY, scene.points) - model.points
    return transform_points(X_WB, seen - middle[0])


def test_the_object_is_where_its_points_are(scene, model):
    X_WO = at(0.1, -0.2, 0.15, 1.0)

    X_WB = model.pose(transform_points(X_WO, scene.points))

    assert_allclose(body_cloud(scene, model, X_WB), transform_points(X_WO, scene.cloud), atol=1e-9)


def test_two_wrong_points_do_not_turn_the_object(scene, model):
    X_WO = at(0.1, -0.2, 0.15, 1.0)
    points = transform_points(X_WO, scene.points)
    wrong = points.copy()
    wrong[:2] += [0.0, 0.06, 0.03]
    points[0] = np.nan

    for seen in (wrong, points):
        assert_allclose(
            body_cloud(scene, model, model.pose(seen)),
            transform_points(X_WO, scene.cloud),
            atol=1e-9,
        )


def test_no_point_moves_by_more_than_the_resolution_between_two_checks(scene, model):
    resolution = EntryClearanceConfig().resolution
    start = model.start(transform_points(at(0.1, -0.2, 0.15), scene.points))
    ball = np.random.default_rng(0).normal(size=(2000, 3))
    ball *= model.radius / np.linalg.norm(ball, axis=1)[:, None]
    # A half turn and a shift of this length are the worst.
    X = make_transform(np.stack([np.eye(3), np.diag([-1.0, -1.0, 1.0])]), np.zeros((2, 3)))
    X[1, 0, 3] = 2.0 * model.radius

    samples = model.edges(start).samples(*vectors_of(X, model.radius))

    moved = np.linalg.norm(np.diff(transform_points(poses_of(samples), ball), axis=0), axis=2)
    assert 0.9 * resolution < moved.max() <= 1.01 * resolution


def test_contact_begins_where_the_reference_stays_near_the_table(scene, model):
    heights = scene.reference.positions[:, :, 2].min(axis=1)

    assert 0 < model.contact < len(heights)
    assert np.all(heights[: model.contact] > 0.01)
    assert np.all(heights[model.contact :] < 0.0105)
    assert model.free[: model.contact].all()


def test_a_reference_may_begin_in_contact_too():
    model = shelf_scene().planner().model

    assert not model.free[0]
    assert model.free[len(model.free) // 2]
    assert not model.free[-1]
    assert model.contact > len(model.free) // 2


def test_clearances_are_those_of_all_pairs():
    scene = rod_scene()
    model = scene.planner().model
    some = slice(None, None, 10)

    X_WO = model_to_object(scene, model.poses[some])
    brute = np.minimum(scene.distance(X_WO), model.reach)

    # The model's cloud is thinned to cells of 6 mm.
    assert_allclose(model.clearances[some], brute, atol=0.002)


def model_to_object(scene, X_WB):
    """Poses of the object's own frame, where the cloud was seen with it at the identity."""
    middle = 0.5 * (scene.cloud.min(axis=0) + scene.cloud.max(axis=0))
    return X_WB @ at(*-middle)


def test_displacement_bounds_what_any_point_moves(scene, model):
    rng = np.random.default_rng(0)
    turns = rotation_exp(rng.normal(size=(20, 3)))
    X = make_transform(turns, rng.normal(scale=0.1, size=(20, 3)))

    bound = model.displacement(X[:10], X[10:])

    clouds = body_cloud(scene, model, X)
    moved = np.linalg.norm(clouds[:10, None] - clouds[None, 10:], axis=-1).max(axis=-1)
    assert np.all(moved <= bound + 0.004)  # thinning moves the cloud's points by 3 mm


def test_pose_is_certain_without_noise_and_uncertain_with(scene, model):
    points = transform_points(at(0.1, -0.2, 0.2), scene.points)
    noisy = points + 0.003 * np.random.default_rng(0).normal(size=points.shape)

    sure, unsure = model.start(points), model.start(noisy)

    assert sure.slack == pytest.approx(0.0, abs=1e-9)
    assert 0.002 < unsure.slack <= 0.01


def test_clearance_demanded_is_the_margin_far_from_the_reference(scene, model):
    start = model.start(transform_points(at(0.0, -0.25, 0.1), scene.points))
    # The cube is 5 cm wide, and the wall's face at y = -1 cm.
    to_the_wall = [-0.035 - 0.009, -0.035 - 0.012]
    X = [model.pose(transform_points(at(0, y, 0.1), scene.points)) for y in to_the_wall]

    assert model.is_free(np.array(X), start).tolist() == [False, True]


def test_where_the_demonstration_comes_close_so_may_the_object(scene, model):
    start = model.start(transform_points(at(0.0, 0.2, 0.2), scene.points))
    shown, aside = at(0.0, 0.22, 0.028), at(0.15, 0.22, 0.028)
    X = [model.pose(transform_points(X, scene.points)) for X in (shown, aside)]

    assert model.is_free(np.array(X), start).tolist() == [True, False]


def test_what_stands_on_the_table_may_slide_but_not_sink(scene, model):
    start = model.start(transform_points(at(0.1, -0.2, 0.0255), scene.points))
    moves = [at(0.1, -0.2, 0.03), at(-0.1, -0.2, 0.0255), at(0.1, -0.2, 0.021)]
    X = [model.pose(transform_points(X, scene.points)) for X in moves]

    assert model.is_free(np.array(X), start).tolist() == [True, True, False]


def test_two_points_are_no_pose(scene, model):
    points = transform_points(NEARBY, scene.points)
    points[2:] = np.nan

    with pytest.raises(TrackingError, match="Only 2 of 8"):
        model.pose(points)


def test_checks_must_not_step_over_a_surface():
    with pytest.raises(InvalidValueError, match="resolution"):
        EntryClearanceConfig(margin=0.004, resolution=0.01)


def test_what_touches_an_obstacle_may_leave_it_and_not_slide_far(scene, model):
    # Against the wall's face at y = -1 cm, 1 mm from it.
    start = model.start(transform_points(at(0.1, -0.036, 0.1), scene.points))
    moves = [at(0.1, -0.04, 0.1), at(0.103, -0.036, 0.1), at(0.16, -0.036, 0.1)]
    X = [model.pose(transform_points(X, scene.points)) for X in moves]

    assert model.is_free(np.array(X), start).tolist() == [True, True, False]
