import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.image_messages import (
    ColorEncoding,
    decode_depth,
    decode_label,
    encode_color,
    encode_depth,
    encode_label,
)

NAMED = {"stamp": 5, "frame_id": "lens"}


@given(arrays(np.float32, (3, 4), elements=st.floats(0.0, 65.0, width=32)))
def test_depth_keeps_half_a_millimetre(depth):
    got = decode_depth(encode_depth(depth, **NAMED).whole())

    assert got.dtype == np.float32
    # Rounding to millimetres, and that of float32 at 65 m.
    assert np.abs(got - depth).max() <= 0.5e-3 + 8e-6


def test_depth_that_means_nothing_becomes_invalid():
    depth = np.array([[np.nan, np.inf, -np.inf, -0.2, 65.54, 65.535]], dtype=np.float32)

    got = decode_depth(encode_depth(depth, **NAMED).whole())

    np.testing.assert_array_equal(got, np.float32([[0, 0, 0, 0, 0, 65.535]]))


@given(arrays(np.int16, (3, 4)))
def test_labels_are_exact(label):
    np.testing.assert_array_equal(decode_label(encode_label(label, **NAMED).whole()), label)


def test_a_depth_image_says_what_it_is():
    message = encode_depth(np.ones((3, 4), np.float32), **NAMED).whole()

    assert (message.width, message.height, message.step) == (4, 3, 8)
    assert message.encoding == "16UC1"
    assert message.frame_id == "lens"
    assert message.timestamp.ToNanoseconds() == 5
    assert message.data[:2] == (1000).to_bytes(2, "little")


def test_jpeg_quality_is_used():
    rgb = np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8)

    sizes = [
        len(encode_color(rgb, encoding=ColorEncoding(jpeg_quality=quality), **NAMED).data)
        for quality in (50, 95)
    ]

    assert sizes[0] < sizes[1]


def test_unknown_formats_are_refused():
    with pytest.raises(InvalidValueError, match="'jpeg', 'raw' or 'png'"):
        ColorEncoding(format="gif")
