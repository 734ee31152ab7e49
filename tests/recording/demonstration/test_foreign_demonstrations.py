"""Recordings of other tools in the layout of demonstrations."""

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.writer import CompressionType


def compressed(extension, pixels, time, frame):
    _, data = cv2.imencode(extension, pixels)
    message = CompressedImage(format=extension[1:], data=data.tobytes(), frame_id=frame)
    message.timestamp.FromNanoseconds(round(time * 1e9))
    return message


def bgr(foreign, i):
    return np.ascontiguousarray(foreign.image(i, stamp=0.0).rgb[..., ::-1])


@pytest.mark.parametrize(
    ("make", "tolerance"),
    [
        (lambda f, i: ("raw", "rgb8", bgr(f, i)[..., ::-1]), 0),
        (lambda f, i: ("raw", "bgr8", bgr(f, i)), 0),
        (lambda f, i: ("raw", "8UC3", bgr(f, i)), 0),
        (lambda f, i: ("raw", "rgba8", cv2.cvtColor(bgr(f, i), cv2.COLOR_BGR2RGBA)), 0),
        (lambda f, i: ("raw", "bgra8", cv2.cvtColor(bgr(f, i), cv2.COLOR_BGR2BGRA)), 0),
        (lambda f, i: ("compressed", ".png", bgr(f, i)), 0),
        # The mean error of lossy formats at their default quality on a smooth picture.
        (lambda f, i: ("compressed", ".jpeg", bgr(f, i)), 3),
        (lambda f, i: ("compressed", ".webp", bgr(f, i)), 6),
    ],
    ids=["rgb8", "bgr8", "8UC3", "rgba8", "bgra8", "png", "jpeg", "webp"],
)
def test_colour_in_any_encoding(foreign, make, tolerance):
    def color(i, time, frame):
        kind, encoding, pixels = make(foreign, i)
        writer = foreign.raw if kind == "raw" else compressed
        return writer(encoding, pixels, time, frame)

    foreign.color = color

    dut = foreign.load()

    got = dut.frames[3].images[0].rgb.astype(float)
    assert np.abs(got - foreign.image(3, stamp=0.0).rgb).mean() <= tolerance


def test_grey_images_become_colour(foreign):
    foreign.color = lambda i, t, frame: foreign.raw(
        "mono8", foreign.image(i, stamp=t).rgb[..., 0].copy(), t, frame
    )

    rgb = foreign.load().frames[0].images[0].rgb

    for channel in range(3):
        np.testing.assert_array_equal(rgb[..., channel], foreign.image(0, stamp=0.0).rgb[..., 0])


@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "png", "32FC1"])
def test_depth_in_any_encoding(foreign, encoding):
    def depth(i, time, frame):
        metres = foreign.image(i, stamp=time).depth
        millimetres = np.rint(1000 * metres).astype("<u2")
        if encoding == "png":
            return compressed(".png", millimetres, time, frame)
        if encoding == "32FC1":
            return foreign.raw(encoding, np.where(metres > 0, metres, np.nan), time, frame)
        return foreign.raw(encoding, millimetres, time, frame)

    foreign.depth = depth

    dut = foreign.load()

    got, wanted = dut.frames[2].images[1].depth, foreign.image(2, stamp=0.0).depth
    assert np.abs(got - wanted).max() <= 0.5e-3 + 1e-6


@pytest.mark.parametrize("where", ["calibration", "transform"])
def test_frames_may_have_a_leading_slash(foreign, where):
    wanted = foreign.load().cameras[0].X_WC
    if where == "calibration":
        calibration = foreign.calibrations["left"]
        calibration.frame_id = "/" + calibration.frame_id
    else:
        for message in foreign.transforms:
            message.child_frame_id = "/" + message.child_frame_id
            message.parent_frame_id = "/" + message.parent_frame_id

    np.testing.assert_array_equal(foreign.load().cameras[0].X_WC, wanted)


def test_rows_may_be_padded(foreign):
    def padded(i, time, frame):
        rgb = foreign.image(i, stamp=time).rgb
        rows = np.pad(rgb.reshape(len(rgb), -1), ((0, 0), (0, 13)))
        message = foreign.raw("rgb8", rows, time, frame)
        message.width = rgb.shape[1]
        return message

    foreign.color = padded

    dut = foreign.load()

    np.testing.assert_array_equal(dut.frames[1].images[0].rgb, foreign.image(1, stamp=0.0).rgb)


def test_transforms_may_be_chained_in_one_message(foreign):
    # The camera is on a stand 0.1 m above a table that is 0.3 m along y from the world.
    together = FrameTransforms()
    for parent, child, translation in (
        ("table", "stand", (0, 0, 0.1)),
        ("world", "table", (0, 0.3, 0)),
    ):
        message = foreign.transform(parent, child, translation)
        message.rotation.x, message.rotation.w = 0.0, 1.0
        together.transforms.append(message)
    for name in ("left", "right"):
        together.transforms.append(foreign.transform("stand", f"{name}_lens", (0.5, 0, 0.6)))
    foreign.transforms = [together]

    dut = foreign.load()

    wanted = np.diag([1.0, -1.0, -1.0, 1.0])
    wanted[:3, 3] = [0.5, 0.3, 0.7]
    np.testing.assert_allclose(dut.cameras[0].X_WC, wanted, atol=1e-12)


def test_the_root_frame_is_the_world_if_no_frame_has_that_name(foreign):
    foreign.transforms = [
        foreign.transform("base_link", f"{name}_lens", (0.4, 0.0, 0.6))
        for name in ("left", "right")
    ]

    dut = foreign.load()

    np.testing.assert_allclose(dut.cameras[1].X_WC[:3, 3], [0.4, 0.0, 0.6])


def test_the_metadata_may_name_the_world(foreign):
    foreign.metadata = {"world_frame": "robot"}
    below = foreign.transform("world", "robot", (0.0, 0.0, 1.0))
    below.rotation.x, below.rotation.w = 0.0, 1.0
    foreign.transforms.append(below)

    dut = foreign.load()

    np.testing.assert_allclose(dut.cameras[0].X_WC[:3, 3], [0.4, 0.4, -0.4])


def test_other_topics_are_ignored(foreign):
    def extra(writer):
        writer.write_message("/log", Log(message="hello"), log_time=0, publish_time=0)
        writer.write_message("/camera/left/faces", Log(), log_time=0, publish_time=0)
        writer.write_message("/camera/left/label", Log(), log_time=0, publish_time=0)
        writer.add_metadata("session", {"operator": "Anne"})

    dut = foreign.load(extra)

    assert len(dut.frames) == 5
    assert dut.metadata == {}


@pytest.mark.parametrize("compression", list(CompressionType))
def test_chunks_in_any_compression(foreign, compression):
    foreign.options = {"compression": compression, "chunk_size": 5000}

    assert len(foreign.load().frames) == 5


def test_a_file_without_chunks(foreign, monkeypatch):
    import mcap_protobuf.writer
    from mcap.writer import Writer

    monkeypatch.setattr(
        mcap_protobuf.writer,
        "McapWriter",
        lambda output, **_: Writer(output, use_chunking=False),
    )

    dut = foreign.load()

    np.testing.assert_array_equal(dut.frames[4].images[1].rgb, foreign.image(4, stamp=0).rgb)


def test_streams_that_are_not_simultaneous_are_paired_by_the_nearest_stamp(foreign):
    # Colour at 8 Hz; left depth twice as fast and late; the right camera is 20 ms late.
    foreign.times["/camera/left/depth"] = [0.03 + i / 16 for i in range(9)]
    for kind in ("image", "depth"):
        foreign.times[f"/camera/right/{kind}"] = [0.02 + i / 8 for i in range(5)]

    dut = foreign.load()

    assert len(dut.frames) == 5
    frame = dut.frames[2]
    assert [image.stamp for image in frame.images] == [0.25, 0.27]
    # At 0.25 s the nearest left depth is that of 0.03 + 4 / 16 = 0.28 s, its fifth.
    wanted = foreign.image(4, stamp=0).depth
    assert np.abs(frame.images[0].depth - wanted).max() <= 0.5e-3 + 1e-6


def test_a_dropped_image_costs_one_frame(foreign):
    del foreign.times["/camera/right/depth"][2]

    dut = foreign.load()

    np.testing.assert_array_equal(dut.stamps, [0.0, 0.125, 0.375, 0.5])


def test_stamps_may_count_from_the_epoch_and_logging_may_be_late(foreign):
    start = 1_760_000_000.0
    foreign.log_offset = 0.2
    foreign.times = {topic: [start + t for t in times] for topic, times in foreign.times.items()}

    dut = foreign.load()

    np.testing.assert_allclose(dut.stamps - start, [0, 0.125, 0.25, 0.375, 0.5], atol=1e-6)


def test_without_stamps_the_log_time_counts(foreign):
    foreign.log_offset = 1.0
    foreign.color = lambda i, t, frame: foreign.raw(
        "rgb8", foreign.image(i, stamp=t).rgb, None, frame
    )
    foreign.depth = lambda i, t, frame: foreign.raw(
        "32FC1", foreign.image(i, stamp=t).depth, None, frame
    )

    dut = foreign.load()

    np.testing.assert_allclose(dut.stamps, [1.0, 1.125, 1.25, 1.375, 1.5])


def test_lens_distortion_is_removed(foreign):
    calibration = foreign.calibrations["left"]
    calibration.distortion_model = "plumb_bob"
    calibration.D.extend([0.8, 0.0, 0.0, 0.0, 0.0])

    dut = foreign.load()

    # The ray (x, y) = ((u - cx) / fx, (v - cy) / fy) of the rectified pixel was seen by the lens at
    # radius r (1 + 0.8 r^2) instead of r. Depth is taken from the pixel nearest to that.
    u, v = 26, 18
    x, y = (u - 15.5) / 30.0, (v - 11.5) / 31.0
    factor = 1 + 0.8 * (x * x + y * y)
    u_lens, v_lens = round(15.5 + 30.0 * x * factor), round(11.5 + 31.0 * y * factor)
    assert (u_lens, v_lens) != (u, v)
    wanted = foreign.image(0, stamp=0).depth[v_lens, u_lens]
    assert dut.frames[0].images[0].depth[v, u] == pytest.approx(wanted, abs=0.5e-3 + 1e-6)
    np.testing.assert_array_equal(dut.frames[0].images[1].rgb, foreign.image(0, stamp=0).rgb)
