import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel
from poil_drake.recording.mcap.camera_messages import (
    decode_calibration,
    decode_transform,
    encode_calibration,
    encode_transform,
)


def test_a_transform_is_the_pose_of_the_child_in_the_parent():
    X = np.eye(4)
    X[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    X[:3, 3] = [1, 2, 3]

    message = encode_transform(X, parent="world", child="lens", stamp=7)

    assert (message.parent_frame_id, message.child_frame_id) == ("world", "lens")
    assert (message.translation.x, message.translation.y, message.translation.z) == (1, 2, 3)
    # A turn by 90 degrees about z is (0, 0, sin 45, cos 45).
    assert message.rotation.z == pytest.approx(np.sqrt(0.5))
    assert message.rotation.w == pytest.approx(np.sqrt(0.5))
    np.testing.assert_allclose(decode_transform(message), X, atol=1e-15)


def test_a_calibration_keeps_the_intrinsics():
    K = np.array([[500, 0, 319.5], [0, 501, 239.5], [0, 0, 1]])

    message = encode_calibration(
        CameraModel("left", 640, 480, K, np.eye(4)), stamp=0, frame_id="lens"
    )
    dut = decode_calibration(message)

    np.testing.assert_array_equal(dut.K, K)
    assert (dut.width, dut.height, dut.frame_id) == (640, 480, "lens")
    assert dut.distortion.size == 0
    # Foxglove projects with P.
    np.testing.assert_array_equal(np.reshape(message.P, (3, 4))[:, :3], K)


def test_a_transform_that_is_not_finite_is_refused():
    message = encode_transform(np.eye(4), parent="world", child="lens", stamp=0)
    message.translation.x = np.nan

    with pytest.raises(InvalidValueError, match="'lens'"):
        decode_transform(message)


def test_distortion_that_is_not_finite_is_refused():
    message = encode_calibration(
        CameraModel("left", 4, 3, np.eye(3), np.eye(4)), stamp=0, frame_id="lens"
    )
    message.D[1] = np.inf

    with pytest.raises(InvalidValueError, match="distortion"):
        decode_calibration(message)
