"""Messages decode to what was encoded; messages that cannot be used are refused."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel
from poil_drake.recording.mcap.message_decoders import (
    decode_calibration,
    decode_depth,
    decode_joint_states,
    decode_label,
    decode_points,
    decode_transform,
)
from poil_drake.recording.mcap.message_encoder import ColorEncoding, EncodedMessage, MessageEncoder

NAMED = {"stamp": 5, "frame_id": "lens"}
POINTS = np.array([[0.1, 0.2, 0.3], [np.nan] * 3])


def message(encoded: EncodedMessage) -> Any:
    return encoded.message_type.FromString(encoded.data)


@pytest.fixture
def dut() -> MessageEncoder:
    return MessageEncoder()


def test_a_transform_is_the_pose_of_the_child_in_the_parent(dut):
    X = np.eye(4)
    X[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    X[:3, 3] = [1, 2, 3]

    got = message(dut.transform(X, parent="world", child="lens", stamp=7))

    assert (got.parent_frame_id, got.child_frame_id) == ("world", "lens")
    assert (got.translation.x, got.translation.y, got.translation.z) == (1, 2, 3)
    # A turn by 90 degrees about z is (0, 0, sin 45, cos 45).
    assert got.rotation.z == pytest.approx(np.sqrt(0.5))
    assert got.rotation.w == pytest.approx(np.sqrt(0.5))
    np.testing.assert_allclose(decode_transform(got), X, atol=1e-15)


def test_a_transform_that_is_not_finite_is_refused(dut):
    damaged = message(dut.transform(np.eye(4), parent="world", child="lens", stamp=0))
    damaged.translation.x = np.nan

    with pytest.raises(InvalidValueError, match="'lens'"):
        decode_transform(damaged)


def test_a_calibration_keeps_the_intrinsics(dut):
    K = np.array([[500, 0, 319.5], [0, 501, 239.5], [0, 0, 1]])

    encoded = message(dut.calibration(CameraModel("left", 640, 480, K, np.eye(4)), **NAMED))
    got = decode_calibration(encoded)

    np.testing.assert_array_equal(got.K, K)
    assert (got.width, got.height, got.frame_id) == (640, 480, "lens")
    assert got.distortion.size == 0
    # Foxglove projects with P.
    np.testing.assert_array_equal(np.reshape(encoded.P, (3, 4))[:, :3], K)


def test_distortion_that_is_not_finite_is_refused(dut):
    camera = CameraModel("left", 4, 3, np.eye(3), np.eye(4))
    damaged = message(dut.calibration(camera, **NAMED))
    damaged.D[1] = np.inf

    with pytest.raises(InvalidValueError, match=r"D = \[0\.0, inf"):
        decode_calibration(damaged)


@given(arrays(np.float32, (3, 4), elements=st.floats(0.0, 65.0, width=32)))
def test_depth_keeps_half_a_millimetre(depth):
    got = decode_depth(message(MessageEncoder().depth(depth, **NAMED)))

    assert got.dtype == np.float32
    # Rounding to millimetres, and that of float32 at 65 m.
    assert np.abs(got - depth).max() <= 0.5e-3 + 8e-6


def test_depth_out_of_range_becomes_invalid(dut):
    depth = np.array([[np.nan, np.inf, -np.inf, -0.2, 65.535, 65.534]], dtype=np.float32)

    got = decode_depth(message(dut.depth(depth, **NAMED)))

    np.testing.assert_array_equal(got, np.float32([[0, 0, 0, 0, 0, 65.534]]))


def test_a_depth_image_describes_itself(dut):
    got = message(dut.depth(np.ones((3, 4), np.float32), **NAMED))

    assert (got.width, got.height, got.step) == (4, 3, 8)
    assert got.encoding == "16UC1"
    assert got.frame_id == "lens"
    assert got.timestamp.ToNanoseconds() == 5
    assert got.data[:2] == (1000).to_bytes(2, "little")


@given(arrays(np.int16, (3, 4)))
def test_labels_are_exact(label):
    got = decode_label(message(MessageEncoder().label(label, **NAMED)))

    np.testing.assert_array_equal(got, label)


def test_jpeg_quality_is_used():
    rgb = np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8)

    encoders = [MessageEncoder(color=ColorEncoding(jpeg_quality=quality)) for quality in (50, 95)]
    small, large = (len(dut.color(rgb, **NAMED).data) for dut in encoders)

    assert small < large


def test_unknown_colour_formats_are_refused():
    with pytest.raises(InvalidValueError, match="'jpeg', 'raw' or 'png'"):
        ColorEncoding(format="gif")


# Half of the last of 24 bits of a number below 1: 3e-8.
@pytest.mark.parametrize(("exact", "loss"), [(True, 0.0), (False, 1e-7)])
@pytest.mark.parametrize("confidence", [None, np.array([0.7, 0.0])])
def test_points_keep_their_positions_and_confidence(dut, confidence, exact, loss):
    got = decode_points(message(dut.points(POINTS, confidence=confidence, exact=exact, **NAMED)))

    expected = np.ones(2) if confidence is None else confidence
    np.testing.assert_allclose(got[0], POINTS, rtol=0.0, atol=loss)
    np.testing.assert_allclose(got[1], expected, rtol=0.0, atol=loss)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda cloud: cloud.fields[0].__setattr__("name", "red"),
        lambda cloud: cloud.fields[1].__setattr__("offset", 0),
        lambda cloud: cloud.fields[2].__setattr__("type", 1),
        lambda cloud: cloud.__setattr__("point_stride", 0),
        lambda cloud: cloud.__setattr__("data", cloud.data[:-1]),
    ],
    ids=["name", "offset", "type", "stride", "data"],
)
def test_other_clouds_are_refused(dut, spoil):
    cloud = message(dut.points(POINTS, **NAMED))
    spoil(cloud)

    with pytest.raises(InvalidValueError, match="point cloud"):
        decode_points(cloud)


def test_joint_states_are_decoded_in_the_order_of_the_names(dut):
    encoded = dut.joint_states(
        ["a", "b"], stamp=0, position=np.array([1.0, np.nan]), effort=np.array([3.0, 4.0])
    )

    values = decode_joint_states(message(encoded), ["b", "a"])

    np.testing.assert_array_equal(values, [[np.nan, 1.0], [np.nan, np.nan], [4.0, 3.0]])


def test_a_missing_joint_is_named(dut):
    with pytest.raises(InvalidValueError, match="'c'"):
        decode_joint_states(message(dut.joint_states(["a"], stamp=0)), ["a", "c"])


# The length of the data takes one byte up to 127, two up to 16383 and three then.
@pytest.mark.parametrize("count", [0, 1, 63, 64, 8191, 8192, 500_000])
def test_data_of_any_length_is_serialized(dut, count):
    label = np.arange(count).astype(np.int16)[None]

    assert message(dut.label(label, **NAMED)).data == label.tobytes()


@pytest.mark.parametrize(
    ("encode", "first", "second"),
    [
        ("points", {"points": np.zeros((2, 3))}, {"points": np.ones((4, 3))}),
        ("depth", {"depth": np.ones((2, 3))}, {"depth": 2.0 * np.ones((2, 3))}),
        (
            "joint_states",
            {"position": np.ones(1), "velocity": np.ones(1)},
            {"position": np.full(1, 3.0)},
        ),
    ],
)
def test_a_message_keeps_nothing_of_the_one_before(dut, encode, first, second):
    named = {"names": ["a"]} if encode == "joint_states" else {"frame_id": "lens"}
    getattr(dut, encode)(stamp=1, **named, **first)

    again = getattr(dut, encode)(stamp=2, **named, **second)

    assert again == getattr(MessageEncoder(), encode)(stamp=2, **named, **second)
