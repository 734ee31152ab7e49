"""Messages of other tools: ROS's compressed depth, and labels of segmenters."""

import struct

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.message_decoders import (
    decode_depth,
    decode_label,
)

MILLIMETRES = np.uint16([[0, 412, 65535], [1000, 65534, 1]])
METRES = np.float32([[0, 0.412, 0], [1, 65.534, 0.001]])


def raw(encoding, pixels):
    return RawImage(
        encoding=encoding,
        data=pixels.tobytes(),
        height=len(pixels),
        width=pixels.shape[1],
        step=pixels.strides[0],
    )


def png(pixels, *, format_="png", header=b""):
    return CompressedImage(format=format_, data=header + cv2.imencode(".png", pixels)[1].tobytes())


def jpeg(pixels):
    data = cv2.imencode(".jpg", pixels)[1].tobytes()
    return CompressedImage(format="mono8; jpeg compressed ", data=data)


@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
def test_depth_of_0_and_65535_is_invalid(encoding):
    np.testing.assert_array_equal(decode_depth(raw(encoding, MILLIMETRES)), METRES)


@pytest.mark.parametrize("format_", ["16UC1; compressedDepth png", "16UC1; compressedDepth"])
def test_compressed_depth_of_ros_has_a_header(format_):
    dut = png(MILLIMETRES, format_=format_, header=struct.pack("<iff", 0, 0.0, 0.0))

    np.testing.assert_array_equal(decode_depth(dut), METRES)


def test_compressed_float_depth_of_ros_holds_the_inverse():
    # The encoder of compressed_depth_image_transport with depth_max 10 m and depth_quantization
    # 100: A = q (q + 1) and B = 1 - A / max; a pixel holds A / depth + B, and 0 for no depth.
    depth = np.float32([[0.4, 1.0, np.nan], [2.5, 9.0, 0.65]])
    a = 100.0 * 101.0
    b = 1.0 - a / 10.0
    with np.errstate(invalid="ignore"):
        steps = np.where(np.isfinite(depth), a / depth + b, 0.0).astype(np.uint16)
    header = struct.pack("<iff", 0, a, b)

    got = decode_depth(png(steps, format_="32FC1; compressedDepth png", header=header))

    # A step of the pixels is depth^2 / A.
    assert got[0, 2] == 0.0
    valid = np.isfinite(depth)
    assert np.all(np.abs(got - depth)[valid] <= 1.01 * depth[valid] ** 2 / a)


@pytest.mark.parametrize("data", [b"", b"\0" * 11, b"\0" * 40])
def test_compressed_depth_without_a_png_is_refused(data):
    dut = CompressedImage(format="16UC1; compressedDepth rvl", data=data)

    with pytest.raises(InvalidValueError, match=r"compressedDepth rvl.*cannot be decoded"):
        decode_depth(dut)


@pytest.mark.parametrize(
    ("encoding", "dtype"),
    [("mono8", "u1"), ("8UC1", "u1"), ("16UC1", "<u2"), ("16SC1", "<i2"), ("32SC1", "<i4")],
)
def test_labels_of_any_integer_type(encoding, dtype):
    label = np.array([[0, 3, 7], [127, 1, 0]])

    got = decode_label(raw(encoding, label.astype(dtype)))

    assert got.dtype == np.int16
    np.testing.assert_array_equal(got, label)


@pytest.mark.parametrize(
    ("dtype", "options"),
    [
        (np.uint8, {}),
        (np.uint16, {}),
        (np.uint16, {"format_": "16UC1; compressedDepth png", "header": bytes(12)}),
    ],
)
def test_labels_may_be_png(dtype, options):
    label = np.array([[0, 3, 7], [200, 1, 0]], dtype)

    np.testing.assert_array_equal(decode_label(png(label, **options)), label)


def test_a_label_that_is_too_large_is_named():
    with pytest.raises(InvalidValueError, match="holds the label 70000"):
        decode_label(raw("32SC1", np.array([[1, 70000]], "<i4")))


@pytest.mark.parametrize(
    ("decode", "dut", "words"),
    [
        (decode_label, raw("32FC1", np.zeros((2, 3), "<f4")), "label image.*'32FC1'.*mono8"),
        (decode_label, png(np.zeros((2, 3, 3), np.uint8)), r"label .* has uint8 .*\(2, 3, 3\)"),
        (decode_label, jpeg(np.zeros((2, 3), np.uint8)), "label .*'mono8; jpeg compressed '.* PNG"),
        (decode_depth, png(np.zeros((2, 3), np.uint8)), "depth .* has uint8.*16-bit for depth"),
        (decode_depth, raw("64FC1", np.zeros((2, 3))), "16UC1, mono16, 32FC1"),
    ],
)
def test_other_pixels_are_refused(decode, dut, words):
    with pytest.raises(InvalidValueError, match=words):
        decode(dut)
