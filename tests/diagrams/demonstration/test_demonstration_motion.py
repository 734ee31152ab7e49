import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poil_drake.diagrams.demonstration.motion import KeyframeMotion, minimum_jerk
from poil_drake.diagrams.scenario.demonstration_config import Keyframe

coordinate = st.floats(-1.0, 1.0)
keyframe_poses = st.lists(
    st.builds(
        Keyframe,
        translation=st.tuples(coordinate, coordinate, coordinate),
        rpy=st.tuples(*[st.floats(-80.0, 80.0)] * 3),
    ),
    min_size=2,
    max_size=5,
).map(lambda keyframes: np.array([keyframe.pose for keyframe in keyframes]))


def test_a_keyframe_turns_about_the_axes_of_the_world():
    dut = Keyframe(translation=(1, 2, 3), rpy=(90, 0, 90)).pose

    # x -> y by yaw; z -> -y by roll, then -y -> x by yaw.
    np.testing.assert_allclose(dut[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(dut[:3, :3] @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_array_equal(dut[:3, 3], [1, 2, 3])


@given(poses=keyframe_poses)
def test_without_blend_every_keyframe_is_reached(poses):
    times = 0.5 * np.arange(len(poses))

    dut = KeyframeMotion(times, poses, blend=0.0)

    for time, pose in zip(times, poses, strict=True):
        np.testing.assert_allclose(dut.pose(time), pose, atol=1e-12)


@given(poses=keyframe_poses, blend=st.floats(0.0, 1.0), time=st.floats(-1.0, 6.0))
def test_blending_keeps_the_ends_and_does_not_overshoot(poses, blend, time):
    dut = KeyframeMotion(np.arange(len(poses)), poses, blend=blend)

    np.testing.assert_allclose(dut.pose(0.0), poses[0], atol=1e-12)
    np.testing.assert_allclose(dut.pose(dut.duration), poses[-1], atol=1e-12)
    X = dut.pose(time)
    np.testing.assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)
    # Each movement is monotone, so where all go one way the motion stays between the keyframes.
    for axis in range(3):
        values = poses[:, axis, 3]
        if np.all(np.diff(values) >= 0):
            assert values[0] - 1e-12 <= X[axis, 3] <= values[-1] + 1e-12


def test_the_motion_is_smooth_and_rests_at_its_ends():
    poses = np.array(
        [
            Keyframe(translation=(0, 0, 0)).pose,
            Keyframe(translation=(0.2, 0, 0.1), rpy=(0, 40, 20)).pose,
            Keyframe(translation=(0.2, 0.3, 0.1), rpy=(30, -10, 0)).pose,
        ]
    )
    dut = KeyframeMotion([0.0, 1.0, 2.0], poses, blend=0.2)
    step = 1e-3
    X = np.array([dut.pose(t) for t in np.arange(-0.1, 2.1, step)])

    velocity = np.gradient(X[:, :3, :], step, axis=0)
    acceleration = np.gradient(velocity, step, axis=0)

    # A jump of the velocity, or of the acceleration, would be of the order of its largest value;
    # in a smooth motion neighbouring samples differ by about the derivative times the step.
    for values in (velocity, acceleration):
        assert np.abs(np.diff(values, axis=0)).max() < 0.03 * np.abs(values).max()
    np.testing.assert_allclose(velocity[[0, -1]], 0.0, atol=1e-12)


def test_a_single_turn_is_about_a_fixed_axis():
    end = np.eye(4)
    end[:3, :3] = Rotation.from_rotvec([0.0, 1.0, 1.0]).as_matrix()

    half = KeyframeMotion([0.0, 2.0], np.array([np.eye(4), end]), blend=0.0).pose(1.0)

    # Minimum jerk is halfway after half of its time.
    np.testing.assert_allclose(
        Rotation.from_matrix(half[:3, :3]).as_rotvec(), [0.0, 0.5, 0.5], atol=1e-12
    )


def test_minimum_jerk_is_at_rest_at_both_ends():
    assert minimum_jerk(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])).tolist() == [0, 0, 0.5, 1, 1]
    # s' = 30 x^2 (1 - x)^2: its largest value, at the middle, is 1.875.
    x = np.linspace(0, 1, 1001)
    assert np.gradient(minimum_jerk(x), x).max() == pytest.approx(1.875, abs=1e-4)
