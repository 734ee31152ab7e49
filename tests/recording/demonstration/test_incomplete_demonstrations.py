"""Every error names the file, the topic and what is missing."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.demonstration import load_demonstration


def without(topic):
    def edit(foreign):
        del foreign.times[topic]

    return edit


def no_calibration(foreign):
    foreign.calibrations["left"] = None


def uncalibrated(foreign):
    foreign.calibrations["left"].K[0] = 0.0


def fisheye(foreign):
    foreign.calibrations["left"].distortion_model = "equidistant"
    foreign.calibrations["left"].D.append(0.1)


def no_transform(foreign):
    del foreign.transforms[1]


def no_transforms(foreign):
    foreign.transforms.clear()


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
    foreign.times["/camera/right/depth"] = [-0.7 + 8.0, 8.7]
    foreign.times["/camera/right/image"] = [8.0 + i / 8 for i in range(5)]
    for kind in ("image", "depth"):
        foreign.times[f"/camera/left/{kind}"] = [8.0 + i / 8 for i in range(5)]


def stops_early(foreign):
    for topic in foreign.times:
        foreign.times[topic] = [i / 8 for i in range(20)]
    foreign.times["/camera/left/depth"] = [i / 8 for i in range(10)]


def nothing(foreign):
    foreign.times.clear()
    foreign.calibrations.clear()


def unknown_colour(foreign):
    foreign.color = lambda i, t, frame: foreign.raw("yuv422", np.zeros((24, 32, 2), np.uint8), t)


def colour_depth(foreign):
    foreign.depth = lambda i, t, frame: foreign.raw("rgb8", np.zeros((24, 32, 3), np.uint8), t)


def small_depth(foreign):
    foreign.depth = lambda i, t, frame: foreign.raw("16UC1", np.ones((12, 16), "<u2"), t)


def short_data(foreign):
    def color(i, t, frame):
        message = foreign.raw("rgb8", foreign.image(i, stamp=t).rgb, t)
        message.data = message.data[:100]
        return message

    foreign.color = color


def unregistered_depth(foreign):
    foreign.depth = lambda i, t, frame: foreign.raw(
        "16UC1", np.ones((24, 32), "<u2"), t, "infrared"
    )


def other_schema(foreign):
    foreign.color = lambda i, t, frame: Log(message="not an image")


def missing_camera(foreign):
    foreign.metadata = {"cameras": '["left", "right", "top"]'}


def broken_camera_list(foreign):
    foreign.metadata = {"cameras": "left, right"}


def broken_label_table(foreign):
    foreign.metadata = {"label_ids": '{"mug": "red"}'}


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (without("/camera/right/depth"), ["camera 'right'", "no topic /camera/right/depth"]),
        (without("/camera/left/image"), ["camera 'left'", "no topic /camera/left/image"]),
        (no_calibration, ["no topic /camera/left/calibration"]),
        (uncalibrated, ["/camera/left/calibration", "not calibrated"]),
        (fisheye, ["/camera/left/calibration", "equidistant", "rectified"]),
        (no_transform, ["'right_lens'", "camera 'right'", "/tf"]),
        (no_transforms, ["'left_lens'", "/tf", "foxglove.FrameTransform"]),
        (zero_quaternion, ["/tf", "'left_lens'", "quaternion"]),
        (one_frame, ["/camera/left/image", "fewer than 2 frames"]),
        (clocks_differ, ["/camera/left/image", "stops 60.00 s before", "clocks"]),
        (out_of_step, ["0 frames in which all cameras have colour and depth"]),
        (stops_early, ["/camera/left/depth", "stops 1.25 s before"]),
        (nothing, ["no camera", "/camera/<name>/image"]),
        (unknown_colour, ["/camera/left/image", "yuv422", "rgb8"]),
        (colour_depth, ["/camera/left/depth", "rgb8", "16UC1"]),
        (small_depth, ["/camera/left/depth", "16 x 12", "32 x 24"]),
        (short_data, ["/camera/left/image", "100 bytes"]),
        (unregistered_depth, ["camera 'left'", "infrared", "registered"]),
        (other_schema, ["/camera/left/image", "foxglove.Log", "foxglove.CompressedImage"]),
        (missing_camera, ["camera 'top'", "'left', 'right'"]),
        (broken_camera_list, ["'cameras'", "JSON"]),
        (broken_label_table, ["'label_ids'", '{"mug": "red"}']),
    ],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_what_is_missing_is_named(tmp_path, foreign, edit, words):
    edit(foreign)
    path = foreign.write(tmp_path / "demo.mcap")

    with pytest.raises(DemonstrationError) as caught:
        load_demonstration(path)

    assert str(path) in str(caught.value)
    for word in words:
        assert word in str(caught.value)
    assert caught.value.remedy


def test_a_camera_that_was_asked_for_is_named(tmp_path, foreign):
    path = foreign.write(tmp_path / "demo.mcap")

    with pytest.raises(DemonstrationError, match="no topic of camera 'wrist'"):
        load_demonstration(path, cameras=["wrist"])


def test_images_in_another_encoding_are_named(tmp_path, foreign):
    def extra(writer):
        inner = writer._writer
        schema = inner.register_schema("sensor_msgs/msg/Image", "ros2msg", b"uint8[] data")
        channel = inner.register_channel("/camera/top/image", "cdr", schema)
        inner.add_message(channel, log_time=0, data=b"\0", publish_time=0)

    path = foreign.write(tmp_path / "demo.mcap", extra)

    with pytest.raises(DemonstrationError, match=r"/camera/top/image.*sensor_msgs/msg/Image.*cdr"):
        load_demonstration(path)


def test_a_frame_that_cannot_be_decoded_is_named_when_asked_for(tmp_path, foreign):
    def color(i, t, frame):
        pixels = np.zeros((24, 32, 3), np.uint8) if i != 3 else np.zeros((6, 8, 3), np.uint8)
        return foreign.raw("rgb8", pixels, t)

    foreign.color = color
    dut = load_demonstration(foreign.write(tmp_path / "demo.mcap"))

    with pytest.raises(DemonstrationError, match=r"/camera/left/image, at 0\.375 s.*8 x 6"):
        dut.frames[3]
