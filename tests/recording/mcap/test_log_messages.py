import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.log_messages import (
    decode_joint_states,
    decode_points,
    encode_joint_states,
    encode_points,
)

POINTS = np.array([[0.1, 0.2, 0.3], [np.nan] * 3])


@pytest.mark.parametrize(("exact", "loss"), [(True, 0.0), (False, 1e-7)])
def test_points_and_their_confidence_come_back(exact, loss):
    message = encode_points(
        POINTS, stamp=0, frame_id="world", confidence=np.array([0.7, 0.0]), exact=exact
    ).whole()

    points, confidence = decode_points(message)

    # Half of the last of 24 bits of a number below 1: 3e-8.
    np.testing.assert_allclose(points, POINTS, rtol=0.0, atol=loss)
    np.testing.assert_allclose(confidence, [0.7, 0.0], rtol=0.0, atol=loss)


def test_points_without_confidence_are_certain():
    points, confidence = decode_points(encode_points(POINTS[:1], stamp=0, frame_id="world").whole())

    assert points.shape == (1, 3)
    np.testing.assert_array_equal(confidence, [1.0])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda message: message.fields[0].__setattr__("name", "red"),
        lambda message: message.fields[1].__setattr__("offset", 0),
        lambda message: message.fields[2].__setattr__("type", 1),
        lambda message: message.__setattr__("point_stride", 0),
        lambda message: message.__setattr__("data", message.data[:-1]),
    ],
    ids=["name", "offset", "type", "stride", "data"],
)
def test_other_clouds_are_refused(spoil):
    message = encode_points(POINTS, stamp=0, frame_id="world").whole()
    spoil(message)

    with pytest.raises(InvalidValueError, match="point cloud"):
        decode_points(message)


def test_joint_states_come_back_in_the_order_asked_for():
    message = encode_joint_states(
        ["a", "b"], stamp=0, position=np.array([1.0, np.nan]), effort=np.array([3.0, 4.0])
    )

    values = decode_joint_states(message, ["b", "a"])

    np.testing.assert_array_equal(values, [[np.nan, 1.0], [np.nan, np.nan], [4.0, 3.0]])


def test_a_missing_joint_is_named():
    with pytest.raises(InvalidValueError, match="'c'"):
        decode_joint_states(encode_joint_states(["a"], stamp=0), ["a", "c"])


def test_a_message_that_is_filled_again_says_the_new_only():
    message = encode_joint_states(["a"], stamp=1, position=np.ones(1), velocity=np.ones(1))

    again = encode_joint_states(["a"], stamp=2, position=np.full(1, 3.0), message=message)

    assert again == encode_joint_states(["a"], stamp=2, position=np.full(1, 3.0))
