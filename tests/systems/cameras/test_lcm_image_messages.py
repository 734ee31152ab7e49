import dataclasses
import zlib

import cv2
import numpy as np
import pytest
from drake import lcmt_image, lcmt_image_array
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import LcmSubscriberSystem
from pydrake.systems.sensors import LcmImageArrayToImages

from poil_drake.errors import NoImageError
from poil_drake.perception.images import RgbdImage
from poil_drake.systems.cameras.lcm_image_messages import decode_images, encode_images

H, W = 3, 5
STAMP = 1_790_000_000.25
RGB = np.arange(H * W * 3, dtype=np.uint8).reshape(H, W, 3)
DEPTH = np.linspace(0.5, 1.5, H * W, dtype=np.float32).reshape(H, W)
LABEL = np.arange(H * W, dtype=np.int16).reshape(H, W) - 2


def image(*, label: np.ndarray | None = LABEL) -> RgbdImage:
    return RgbdImage(rgb=RGB, depth=DEPTH, stamp=STAMP, label=label)


def message() -> lcmt_image_array:
    return lcmt_image_array.decode(encode_images(image(), camera="left"))


def replaced(index: int, **fields: object) -> bytes:
    """Returns the message with other fields in one of its images."""
    array = message()
    for name, value in fields.items():
        setattr(array.images[index], name, value)
    array.images[index].size = len(array.images[index].data)
    return array.encode()


def test_images_are_decoded_to_the_last_bit() -> None:
    found = decode_images(encode_images(image(), camera="left"), size=(H, W))

    np.testing.assert_array_equal(found.rgb, RGB)
    np.testing.assert_array_equal(found.depth, DEPTH)
    np.testing.assert_array_equal(found.label, LABEL)
    assert found.stamp == STAMP


def test_labels_are_optional() -> None:
    sent = encode_images(image(label=None), camera="left")

    assert decode_images(sent, size=(H, W)).label is None


def test_drakes_own_systems_read_the_colours() -> None:
    lcm, builder = DrakeLcm("memq://images"), DiagramBuilder()
    receiver = builder.AddSystem(
        LcmSubscriberSystem.Make("IMAGES", lcmt_image_array, lcm, use_cpp_serializer=True)
    )
    dut = builder.AddSystem(LcmImageArrayToImages())
    builder.Connect(receiver.get_output_port(), dut.get_input_port(0))
    diagram = builder.Build()
    simulator = Simulator(diagram)

    lcm.Publish("IMAGES", encode_images(image(), camera="left"))
    lcm.HandleSubscriptions(0)
    simulator.AdvanceTo(0.1)

    context = dut.GetMyContextFromRoot(simulator.get_context())
    color = dut.GetOutputPort("color_image").Eval(context)
    np.testing.assert_array_equal(color.data[:, :, :3], RGB)
    # Of depth that is not compressed, Drake 1.51 reads only as many bytes as there are pixels.


@pytest.mark.parametrize(
    ("pixel_format", "pixels"),
    [
        (lcmt_image.PIXEL_FORMAT_BGR, RGB[:, :, ::-1]),
        (lcmt_image.PIXEL_FORMAT_RGBA, np.dstack([RGB, RGB[:, :, :1]])),
        (lcmt_image.PIXEL_FORMAT_BGRA, np.dstack([RGB[:, :, ::-1], RGB[:, :, :1]])),
    ],
)
def test_colours_may_be_in_another_order(pixel_format: int, pixels: np.ndarray) -> None:
    sent = replaced(0, pixel_format=pixel_format, data=pixels.tobytes())

    np.testing.assert_array_equal(decode_images(sent, size=(H, W)).rgb, RGB)


def test_depth_in_millimetres_becomes_metres() -> None:
    millimetres = np.rint(1e3 * DEPTH).astype("<u2")
    millimetres[0, :2] = 65535, 0  # Too far, and not measured.
    sent = replaced(1, channel_type=lcmt_image.CHANNEL_TYPE_UINT16, data=millimetres.tobytes())

    depth = decode_images(sent, size=(H, W)).depth

    assert depth.dtype == np.float32
    np.testing.assert_array_equal(depth[0, :2], 0.0)
    np.testing.assert_allclose(depth[1:], DEPTH[1:], atol=0.5e-3 + 1e-6)


def test_depth_that_is_no_distance_becomes_invalid() -> None:
    depth = DEPTH.copy()
    depth[0, 0], depth[1, 1], depth[1, 2] = np.inf, np.nan, -0.5
    sent = replaced(1, data=depth.tobytes())

    found = decode_images(sent, size=(H, W)).depth

    assert found[0, 0] == found[1, 1] == found[1, 2] == 0.0
    assert found[2, 2] == DEPTH[2, 2]


@pytest.mark.parametrize("utime", [0, -5])
def test_a_message_without_the_time_of_capture_is_refused(utime: int) -> None:
    said = message()
    said.header.utime = utime

    with pytest.raises(NoImageError, match=f"header.utime is {utime}, not the time of capture"):
        decode_images(said.encode(), size=(H, W))


def test_depth_of_another_type_is_refused() -> None:
    sent = replaced(1, channel_type=lcmt_image.CHANNEL_TYPE_UINT8, data=b"\1" * (H * W))

    with pytest.raises(NoImageError, match="unsupported type uint8"):
        decode_images(sent, size=(H, W))


def test_images_may_be_compressed() -> None:
    said = message()
    said.images[0].data = cv2.imencode(".png", RGB[:, :, ::-1])[1].tobytes()
    said.images[0].compression_method = lcmt_image.COMPRESSION_METHOD_PNG
    said.images[1].data = zlib.compress(DEPTH.tobytes())
    said.images[1].compression_method = lcmt_image.COMPRESSION_METHOD_ZLIB
    for one in said.images:
        one.size = len(one.data)

    found = decode_images(said.encode(), size=(H, W))

    np.testing.assert_array_equal(found.rgb, RGB)
    np.testing.assert_array_equal(found.depth, DEPTH)


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        (b"garbage", "7 bytes are no lcmt_image_array"),
        (encode_images(image(), camera="left")[:-9], "are no lcmt_image_array"),
        (replaced(0, width=W + 1), "6 x 3 pixels, not 5 x 3"),
        (replaced(0, data=b"\0" * 7), "holds 7 bytes instead of 45"),
        (replaced(0, channel_type=lcmt_image.CHANNEL_TYPE_FLOAT64), "channel type 7"),
        (replaced(0, pixel_format=lcmt_image.PIXEL_FORMAT_DISPARITY), "no 8-bit colour image"),
        (replaced(0, compression_method=lcmt_image.COMPRESSION_METHOD_PNG), "an unreadable size"),
        (replaced(0, compression_method=lcmt_image.COMPRESSION_METHOD_ZLIB), "invalid zlib data"),
        (replaced(0, compression_method=7), "unsupported compression 7"),
        (
            replaced(
                1,
                compression_method=lcmt_image.COMPRESSION_METHOD_ZLIB,
                data=zlib.compress(b"\0" * 10_000_000),
            ),
            "holds 61 bytes instead of 60",
        ),
    ],
)
def test_an_error_says_what_is_wrong_with_a_message(sent: bytes, said: str) -> None:
    with pytest.raises(NoImageError, match=said):
        decode_images(sent, size=(H, W))


@pytest.mark.parametrize(
    ("kind", "method"),
    [
        (".png", lcmt_image.COMPRESSION_METHOD_PNG),
        (".jpg", lcmt_image.COMPRESSION_METHOD_JPEG),
    ],
)
def test_a_small_message_that_unfolds_to_many_pixels_is_not_decoded(
    monkeypatch: pytest.MonkeyPatch, kind: str, method: int
) -> None:
    bomb = cv2.imencode(kind, np.zeros((512, 256, 3), np.uint8))[1].tobytes()
    sent = replaced(0, data=bomb, compression_method=method)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("It was decoded."))

    with pytest.raises(NoImageError, match="has 256 x 512 pixels, not 5 x 3"):
        decode_images(sent, size=(H, W))


def test_stamps_are_kept_to_the_microsecond() -> None:
    sent = encode_images(dataclasses.replace(image(), stamp=STAMP + 1e-6), camera="left")

    assert decode_images(sent, size=(H, W)).stamp == pytest.approx(STAMP + 1e-6, abs=2e-7)
