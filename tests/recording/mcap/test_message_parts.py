import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from poil_drake.recording.mcap.image_messages import encode_depth
from poil_drake.recording.mcap.log_messages import encode_points
from poil_drake.recording.mcap.message_parts import MessageParts


@pytest.mark.parametrize("size", [0, 1, 127, 128, 16383, 16384, 1_000_000])
def test_parts_are_serialized_as_the_whole_is(size: int) -> None:
    dut = MessageParts(RawImage(width=3, encoding="16UC1"), bytes(size))

    assert RawImage.FromString(dut.serialized()) == RawImage(
        width=3, encoding="16UC1", data=bytes(size)
    )


def test_a_cloud_that_is_filled_again_says_the_new_only() -> None:
    first = encode_points(np.zeros((2, 3)), stamp=1, frame_id="world")

    again = encode_points(np.ones((4, 3)), stamp=2, frame_id="world", message=first.message)

    assert again.whole() == encode_points(np.ones((4, 3)), stamp=2, frame_id="world").whole()


def test_an_image_that_is_filled_again_says_the_new_only() -> None:
    first = encode_depth(np.ones((2, 3)), stamp=1, frame_id="lens")

    again = encode_depth(2 * np.ones((2, 3)), stamp=2, frame_id="lens", message=first.message)

    assert again.whole() == encode_depth(2 * np.ones((2, 3)), stamp=2, frame_id="lens").whole()
