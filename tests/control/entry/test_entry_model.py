import numpy as np
import pytest
from entry_scenes import at, rod_scene, shelf_scene, wall_scene
from numpy.testing import assert_allclose

from poil_drake.control.entry.entry_clearance import EntryClearanceConfig
from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.planning.rrt_connect import poses_of, vectors_of

NEARBY = make_transform(rotation_exp([0.2, -0.3, 0.5]), [-0.1, 0.2, 0.3])


@pytest.fixture(scope="module")
def scene():
    return wall_scene()


@pytest.fixture(scope="module")
def model(scene):
    return scene.planner(X_WO=NEARBY).model


def body_cloud(scene, model, X_WB):
    """The object's cloud at poses of the body frame, which has the world's axes at `NEARBY`."""
    seen = transform_points(NEARBY, scene.cloud)
    middle = scene.points_at(NEARBY) - model.points
    return transform_points(X_WB, seen - middle[0])


def test_pose_carries_the_cloud_to_the_object_despite_wrong_points(scene, model):
    X_WO = at(0.1, -0.2, 0.15, 1.0)
    points = scene.points_at(X_WO)
    wrong, unseen = points.copy(), points.copy()
    wrong[:2] += [0.0, 0.06, 0.03]
    unseen[0] = np.nan

    for observed in (points, wrong, unseen):
        cloud = body_cloud(scene, model, model.pose(observed))
        assert_allclose(cloud, transform_points(X_WO, scene.cloud), atol=1e-9)


def test_two_points_do_not_determine_a_pose(scene, model):
    points = scene.points_at(NEARBY)
    points[2:] = np.nan

    with pytest.raises(TrackingError, match="Only 2 of 8"):
        model.pose(points)


def test_no_point_moves_by_more_than_the_resolution_between_two_checks(scene, model):
    start = model.start(scene.points_at(at(0.1, -0.2, 0.15)))
    ball = np.random.default_rng(0).normal(size=(2000, 3))
    ball *= model.radius / np.linalg.norm(ball, axis=1)[:, None]
    # A half turn and a shift of this length are the worst case.
    X = make_transform(np.stack([np.eye(3), np.diag([-1.0, -1.0, 1.0])]), np.zeros((2, 3)))
    X[1, 0, 3] = 2.0 * model.radius

    samples = model.edges(start).samples(*vectors_of(X, model.radius))

    moved = np.linalg.norm(np.diff(transform_points(poses_of(samples), ball), axis=0), axis=2)
    assert 0.009 < moved.max() <= 0.0101


def test_contact_begins_where_the_reference_stays_near_the_table(scene, model):
    heights = scene.reference.positions[:, :, 2].min(axis=1)

    assert 0 < model.contact < len(heights)
    assert np.all(heights[: model.contact] > 0.01)
    assert np.all(heights[model.contact :] < 0.0105)
    assert model.free[: model.contact].all()


def test_a_reference_may_also_begin_in_contact():
    model = shelf_scene().planner().model

    assert not model.free[0]
    assert model.free[len(model.free) // 2]
    assert not model.free[-1]
    assert model.contact > len(model.free) // 2


def test_clearances_are_those_of_all_pairs():
    scene = rod_scene()
    model = scene.planner().model
    poses = model.poses[::10]

    # The cloud was observed with the object's own frame at the identity.
    middle = 0.5 * (scene.cloud.min(axis=0) + scene.cloud.max(axis=0))
    expected = np.minimum(scene.distance(poses @ at(*-middle)), model.reach)

    # The model's cloud is thinned to cells of 6 mm.
    assert_allclose(model.clearances[::10], expected, atol=0.002)


def test_displacement_bounds_the_motion_of_all_points(scene, model):
    rng = np.random.default_rng(0)
    turns = rotation_exp(rng.normal(size=(20, 3)))
    X = make_transform(turns, rng.normal(scale=0.1, size=(20, 3)))

    bound = model.displacement(X[:10], X[10:])

    clouds = body_cloud(scene, model, X)
    moved = np.linalg.norm(clouds[:10, None] - clouds[None, 10:], axis=-1).max(axis=-1)
    assert np.all(moved <= bound + 0.004)  # thinning moves the cloud's points by 3 mm


def test_pose_is_certain_without_noise_and_uncertain_with_noise(scene, model):
    points = scene.points_at(at(0.1, -0.2, 0.2))
    noisy = points + 0.003 * np.random.default_rng(0).normal(size=points.shape)

    assert model.start(points).uncertainty == pytest.approx(0.0, abs=1e-9)
    assert 0.002 < model.start(noisy).uncertainty <= 0.01


@pytest.mark.parametrize(
    ("start", "poses", "free"),
    [
        # The cube is 5 cm wide, and the wall's face is at y = -1 cm: 9 and 12 mm from it.
        pytest.param(
            at(0.0, -0.25, 0.1),
            [at(0, -0.044, 0.1), at(0, -0.047, 0.1)],
            [False, True],
            id="margin far from the reference",
        ),
        pytest.param(
            at(0.0, 0.2, 0.2),
            [at(0.0, 0.22, 0.028), at(0.15, 0.22, 0.028)],
            [True, False],
            id="less where the demonstration comes closer",
        ),
        pytest.param(
            at(0.1, -0.2, 0.0255),
            [at(0.1, -0.2, 0.03), at(-0.1, -0.2, 0.0255), at(0.1, -0.2, 0.021)],
            [True, True, False],
            id="on the table it may slide but not sink",
        ),
        # 1 mm from the wall's face.
        pytest.param(
            at(0.1, -0.036, 0.1),
            [at(0.1, -0.04, 0.1), at(0.103, -0.036, 0.1), at(0.16, -0.036, 0.1)],
            [True, True, False],
            id="in contact at the start it may leave but not slide far",
        ),
    ],
)
def test_required_clearance(scene, model, start, poses, free):
    X = np.array([model.pose(scene.points_at(pose)) for pose in poses])

    assert model.is_free(X, model.start(scene.points_at(start))).tolist() == free


def test_margin_must_not_be_less_than_half_of_the_resolution():
    with pytest.raises(InvalidValueError, match="margin"):
        EntryClearanceConfig(margin=0.004)
