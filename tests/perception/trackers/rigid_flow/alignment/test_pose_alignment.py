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
from poil_drake.perception.trackers.rigid_flow.alignment.pose_location import look_around

motions = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)


@given(motions, motions)
def test_motion_between_inverts_move(start, motion):
    X = move(np.eye(4), start)

    np.testing.assert_allclose(motion_between(X, move(X, motion)), motion, atol=1e-9)


def test_a_motion_is_in_the_object_s_frame():
    X = make_transform(rotation_exp(np.array([0.0, 0.0, np.pi / 2])), np.array([1.0, 2.0, 3.0]))

    moved = move(X, np.array([0, 0, 0, 0.1, 0, 0]))

    # The object's x axis is the world's y axis.
    np.testing.assert_allclose(moved[:3, 3], [1.0, 2.1, 3.0])


def test_deviations_of_points_match_those_of_sampled_poses():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6)) * 1e-3
    dut = PoseEstimate(np.eye(4), np.eye(6), root @ root.T)
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.03, -0.02, 0.08]])

    samples = np.array([root @ rng.normal(size=6) for _ in range(4000)])
    moved = np.array([transform_points(move(np.eye(4), s), points) for s in samples])

    expected = np.sqrt(np.mean(np.sum((moved - points) ** 2, axis=2), axis=0))
    np.testing.assert_allclose(dut.point_deviations(points), expected, rtol=0.05)


def aligned(mug, motion, deviation):
    """Aligns the mug's model from a pose that is off by a motion."""
    start = move(mug.X_WO, np.array(motion))
    predicted = PoseEstimate(start, deviation**2 * np.eye(6), deviation**2 * np.eye(6))
    return align(mug.model, *look_around(mug.model, mug.frame, start), predicted)


def test_recovers_from_a_pose_several_pixels_off(built_mug):
    pose = aligned(built_mug, [0.05, -0.04, 0.06, 0.004, -0.004, 0.005], 0.1)

    error = motion_between(built_mug.X_WO, pose.X_WO)
    assert np.linalg.norm(error[:3]) < np.radians(0.5)
    assert np.linalg.norm(error[3:]) < 5e-4


def test_the_views_reduce_the_uncertainty(built_mug):
    pose = aligned(built_mug, np.zeros(6), 0.1)

    assert np.all(np.linalg.eigvalsh(pose.covariance) < 0.01)
    # Only the prior covariance counts noise as information.
    assert np.all(np.linalg.eigvalsh(pose.covariance - pose.prior_covariance) > -1e-12)


def test_a_certain_prediction_outweighs_the_views(built_mug):
    pose = aligned(built_mug, [0.0, 0.0, 0.01, 0.0, 0.0, 0.0], 1e-7)

    assert motion_between(built_mug.X_WO, pose.X_WO)[2] == pytest.approx(0.01, rel=0.05)
