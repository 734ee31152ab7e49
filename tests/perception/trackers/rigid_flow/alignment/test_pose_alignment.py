import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import (
    PoseEstimate,
    align,
    motion_between,
    move,
)
from poil_drake.perception.trackers.rigid_flow.appearance_model import observe
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.object_model import build_model
from poil_drake.perception.trackers.rigid_flow.view_window import make_window

motions = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)


@given(motions, motions)
def test_motion_between_inverts_move(start, motion):
    X = move(np.eye(4), start)

    np.testing.assert_allclose(motion_between(X, move(X, motion)), motion, atol=1e-9)


def test_move_is_in_the_object_s_own_frame():
    X = make_transform(rotation_exp(np.array([0.0, 0.0, np.pi / 2])), np.array([1.0, 2.0, 3.0]))

    moved = move(X, np.array([0, 0, 0, 0.1, 0, 0]))

    # The object's x axis is the world's y axis.
    np.testing.assert_allclose(moved[:3, 3], [1.0, 2.1, 3.0])


def test_deviations_of_points_are_those_of_sampled_poses():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6)) * 1e-3
    dut = PoseEstimate(np.eye(4), np.eye(6), root @ root.T)
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.03, -0.02, 0.08]])

    samples = np.array([root @ rng.normal(size=6) for _ in range(4000)])
    moved = np.array([transform_points(move(np.eye(4), s), points) for s in samples])

    expected = np.sqrt(np.mean(np.sum((moved - points) ** 2, axis=2), axis=0))
    np.testing.assert_allclose(dut.point_deviations(points), expected, rtol=0.05)


@pytest.fixture
def aligned(mug_scene):
    """A function that aligns the mug's model from a pose that is off by a motion."""
    config = RigidFlowConfig()
    shot = mug_scene.shoot(mug_scene.start)
    model, X_WO = build_model(shot.frame, mug_scene.handle_points, shot.masks, config)

    def run(motion, deviation):
        start = move(X_WO, np.array(motion))
        predicted = PoseEstimate(start, deviation**2 * np.eye(6), deviation**2 * np.eye(6))
        points = transform_points(start, model.points)
        views = zip(shot.frame.cameras, shot.frame.images, strict=True)
        windows = [make_window(i, c, im, points, config.window) for i, (c, im) in enumerate(views)]
        around = observe(
            model.appearance, shot.frame, start[None, :3, 3], model.radius, config.appearance
        )
        return align(model, windows, around, predicted, config), X_WO

    return run


def test_finds_back_from_a_pose_several_pixels_off(aligned):
    pose, X_WO = aligned([0.05, -0.04, 0.06, 0.004, -0.004, 0.005], 0.1)

    error = motion_between(X_WO, pose.X_WO)
    assert np.linalg.norm(error[:3]) < np.radians(0.5)
    assert np.linalg.norm(error[3:]) < 5e-4


def test_views_make_the_pose_surer_than_its_prediction(aligned):
    pose, _ = aligned(np.zeros(6), 0.1)

    assert np.all(np.linalg.eigvalsh(pose.doubt) < 0.01)
    # What noise seems to tell is left out of doubt, but not out of the other covariance.
    assert np.all(np.linalg.eigvalsh(pose.doubt - pose.covariance) > -1e-12)


def test_a_tight_prediction_is_kept_to(aligned):
    pose, X_WO = aligned([0.0, 0.0, 0.01, 0.0, 0.0, 0.0], 1e-7)

    # 2 mm of freedom for 10 mrad: the prediction outweighs the views by far.
    assert motion_between(X_WO, pose.X_WO)[2] == pytest.approx(0.01, rel=0.05)
