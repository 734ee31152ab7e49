"""Errors name the file, the topic and the problem."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Log_pb2 import Log

from poil_drake.errors import DemonstrationError

RGB, MM = np.zeros((24, 32, 3), np.uint8), np.ones((24, 32), "<u2")


def having(**attributes):
    """Returns an edit that sets attributes of a recording."""

    def edit(foreign):
        for name, value in attributes.items():
            setattr(foreign, name, value)

    return edit


def without(attribute, key):
    return lambda foreign: getattr(foreign, attribute).pop(key)


def calibrated(**fields):
    """Returns an edit after which a calibration has other fields."""

    def edit(foreign):
        foreign.calibrations["left"].MergeFrom(CameraCalibration(**fields))
        del foreign.calibrations["left"].K[:-9]

    return edit


def fisheye(foreign):
    foreign.calibrations["left"].distortion_model = "equidistant"
    foreign.calibrations["left"].D.append(0.1)


def one_optical_frame(foreign):
    foreign.calibrations["right"].frame_id = "left_lens"


def zero_quaternion(foreign):
    foreign.transforms[0].rotation.x = 0.0


def one_frame(foreign):
    foreign.times = {topic: times[:1] for topic, times in foreign.times.items()}


def clocks_differ(foreign):
    for kind in ("image", "depth"):
        times = foreign.times[f"/camera/right/{kind}"]
        foreign.times[f"/camera/right/{kind}"] = [time + 60.0 for time in times]


def out_of_step(foreign):
    # Never within half a period of 1/8 s of each other, though they end together.
    times = [8.0 + i / 8 for i in range(5)]
    foreign.times = dict.fromkeys(foreign.times, times) | {"/camera/right/depth": [7.3, 8.7]}


def drops_alternately(foreign):
    # From image 11 of 24 on, each camera drops every other image, but never both the same.
    for topic in foreign.times:
        kept = [i for i in range(24) if i <= 10 or i % 2 == ("left" in topic)]
        foreign.times[topic] = [i / 8 for i in kept]


def stops_early(foreign):
    times = [i / 8 for i in range(20)]
    foreign.times = dict.fromkeys(foreign.times, times) | {"/camera/left/depth": times[:10]}


def showing(kind, encoding, pixels, *, frame_id="", size=None):
    """Returns an edit after which all "color" or "depth" images have `size` bytes of pixels."""

    def edit(foreign):
        message = foreign.raw(encoding, pixels, None, frame_id)
        message.data = message.data[:size]
        setattr(foreign, kind, lambda i, t, frame: message)

    return edit


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (without("times", "/camera/right/depth"), ["'right' has no topic /camera/right/depth"]),
        (without("times", "/camera/left/image"), ["camera 'left' has no topic /camera/left/image"]),
        (without("calibrations", "left"), ["no topic /camera/left/calibration"]),
        (calibrated(K=[0.0] * 9), ["/camera/left/calibration", "is invalid: 32 x 24 pixels"]),
        (calibrated(K=[30.0, 0, 16, 0, 30, 12, 0, 0, 0]), ["is invalid", "[fx, 0, cx, 0, fy"]),
        # In shares of the image's width.
        (calibrated(K=[0.9, 0, 0.5, 0, 0.9, 0.4, 0, 0, 1], width=640), ["K = [0.9,"]),
        (fisheye, ["/camera/left/calibration", "equidistant", "rectified"]),
        (without("transforms", 1), ["'right_lens'", "camera 'right'", "/tf"]),
        (having(transforms=[]), ["'left_lens'", "/tf", "foxglove.FrameTransform"]),
        (one_optical_frame, ["the cameras left and right have the same frame, 'left_lens'"]),
        (zero_quaternion, ["/tf", "'left_lens'", "quaternion"]),
        (one_frame, ["/camera/left/image", "at least 2 are needed"]),
        (clocks_differ, ["/camera/left/image", "stops 60.00 s before", "clocks"]),
        (out_of_step, ["needs at least 2 frames in which all cameras have", "but has 0"]),
        (drops_alternately, ["in the last 1.62 s", "/camera/right/depth", "of the same time"]),
        (stops_early, ["/camera/left/depth", "stops 1.25 s before"]),
        (having(times={}, calibrations={}), ["no camera", "/camera/<name>/image"]),
        (showing("color", "yuv422", RGB[..., :2]), ["/camera/left/image", "yuv422", "rgb8"]),
        (showing("depth", "rgb8", RGB), ["/camera/left/depth", "rgb8", "16UC1"]),
        (showing("depth", "16UC1", MM[:12, :16]), ["/left/depth", "16 x 12", "32 x 24"]),
        (showing("color", "rgb8", RGB, size=100), ["/camera/left/image", "100 bytes"]),
        (
            showing("depth", "16UC1", MM, frame_id="infrared"),
            ["camera 'left'", "infrared", "registered"],
        ),
        (
            having(color=lambda i, t, frame: Log(message="not an image")),
            ["/camera/left/image", "foxglove.Log", "foxglove.CompressedImage"],
        ),
        (
            having(metadata={"cameras": '["left", "right", "top"]'}),
            ["camera 'top'", "'left', 'right'"],
        ),
        (having(metadata={"cameras": "left, right"}), ["'cameras'", "JSON"]),
        (having(metadata={"label_ids": '{"mug": "red"}'}), ["'label_ids'", '{"mug": "red"}']),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_errors_name_the_problem(foreign, edit, words):
    edit(foreign)

    with pytest.raises(DemonstrationError) as caught:
        foreign.load()

    assert str(foreign.path) in str(caught.value)
    for word in words:
        assert word in str(caught.value)
    assert caught.value.remedy


def test_errors_name_a_camera_that_is_not_in_the_file(foreign):
    with pytest.raises(DemonstrationError, match="camera 'wrist' has no topic"):
        foreign.load(cameras=["wrist"])


def test_errors_name_another_encoding(foreign):
    def extra(writer):
        inner = writer._writer
        schema = inner.register_schema("sensor_msgs/msg/Image", "ros2msg", b"uint8[] data")
        channel = inner.register_channel("/camera/top/image", "cdr", schema)
        inner.add_message(channel, log_time=0, data=b"\0", publish_time=0)

    with pytest.raises(DemonstrationError, match=r"/camera/top/image.*sensor_msgs/msg/Image.*cdr"):
        foreign.load(extra)


def test_errors_name_a_frame_that_cannot_be_decoded(foreign):
    def color(i, t, frame):
        pixels = np.zeros((24, 32, 3), np.uint8) if i != 3 else np.zeros((6, 8, 3), np.uint8)
        return foreign.raw("rgb8", pixels, t)

    foreign.color = color
    dut = foreign.load()

    with pytest.raises(DemonstrationError, match=r"/camera/left/image, at 0\.375 s.*8 x 6"):
        dut.frames[3]


@pytest.mark.parametrize("count", [1, 3, 6, 9])
def test_distortion_of_an_unknown_length_is_rejected(foreign, count):
    calibration = foreign.calibrations["left"]
    calibration.distortion_model = "plumb_bob"
    calibration.D.extend([0.01] * count)

    with pytest.raises(DemonstrationError, match=f"has {count} distortion coefficients") as info:
        foreign.load()

    assert "4, 5, 8, 12 or 14" in info.value.remedy
