"""Bags of two RealSense cameras become demonstrations."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.reader import make_reader
from ros_bags import (
    RosRecording,
    camera_info,
    compressed_depth,
    compressed_float_depth,
    compressed_image,
    header,
    raw_image,
    transforms,
)
from small_frames import HEIGHT, WIDTH, K, camera, image

from poil_drake.recording.demonstration.demonstration import Demonstration, load_demonstration
from poil_drake.recording.ros_bag.bag import RosBag
from poil_drake.recording.ros_bag.bag_import import import_ros_bag

COLOR, DEPTH = "/left/color/image_raw", "/left/aligned_depth_to_color/image_raw"
INFO, FRAME = "/left/color/camera_info", "left_color_optical_frame"
CAMERAS = {"left": "/left", "right": "/right"}


@pytest.fixture
def recording() -> RosRecording:
    return RosRecording.of_small_frames()


def load(recording: RosRecording, folder: Path, **options) -> Demonstration:
    """Writes a bag, imports it and loads the result."""
    bag = recording.write_mcap(folder / "bag.mcap")
    import_ros_bag(bag, folder / "demo.mcap", cameras=CAMERAS, **options)
    return load_demonstration(folder / "demo.mcap")


def check_small_frames(dut: Demonstration, recording: RosRecording) -> None:
    assert len(dut.frames) == 5
    np.testing.assert_array_equal(dut.stamps, recording.start / 1e9 + np.arange(5) / 8)
    for i, frame in enumerate(dut.frames):
        for model, got in zip(frame.cameras, frame.images, strict=True):
            wanted = image(i, stamp=i / 8)
            np.testing.assert_array_equal(got.rgb, wanted.rgb)
            np.testing.assert_allclose(got.depth, wanted.depth, atol=0.5e-3 + 1e-6)
            np.testing.assert_allclose(model.X_WC, camera(model.name).X_WC, atol=1e-12)
            np.testing.assert_array_equal(model.K, K)


@pytest.mark.parametrize("form", ["mcap", "folder", "db3", "zstd", "killed", "in parts"])
def test_bags_of_any_form(recording, tmp_path, form):
    if form == "mcap":
        bag = recording.write_mcap(tmp_path / "bag.mcap")
    elif form == "db3":
        bag = recording.write_db3(tmp_path / "bag")
    else:
        bag = recording.write_folder(tmp_path / "bag")
    if form == "zstd":
        data = (bag / "bag_0.mcap").read_bytes()
        (bag / "bag_0.mcap.zstd").write_bytes(zstandard.compress(data))
        text = (bag / "metadata.yaml").read_text().replace("bag_0.mcap", "bag_0.mcap.zstd")
        text = text.replace("compression_format: ''", "compression_format: zstd")
        text = text.replace("compression_mode: ''", "compression_mode: FILE")
        (bag / "metadata.yaml").write_text(text)
        (bag / "bag_0.mcap").unlink()
    elif form == "killed":
        (bag / "metadata.yaml").unlink()
    elif form == "in parts":
        (bag / "metadata.yaml").unlink()
        first, second = RosRecording(), RosRecording()
        for message in recording.messages:
            (first if message[1] < recording.start + 250_000_000 else second).messages += [message]
        # In the order of names, part 10 is before part 2.
        second.write_mcap(bag / "bag_10.mcap")
        first.write_mcap(bag / "bag_2.mcap")
        (bag / "bag_0.mcap").unlink()

    dut = import_ros_bag(bag, tmp_path / "demo.mcap", cameras=CAMERAS)

    assert (dut.frames, dut.duration) == (5, 0.5)
    assert dut.topics["/camera/right/depth"] == "/right/aligned_depth_to_color/image_raw"
    check_small_frames(load_demonstration(tmp_path / "demo.mcap"), recording)


def test_bags_of_ros_1(recording, tmp_path):
    recording.write_db3(tmp_path / "bag")
    program = Path(sys.executable).with_name("rosbags-convert")
    command = f"{program} --src bag --dst ros1.bag"
    types = "--src-typestore ros2_humble --dst-typestore ros1_noetic"
    subprocess.run(f"{command} {types}".split(), cwd=tmp_path, check=True)
    with RosBag(tmp_path / "ros1.bag") as dut:
        assert f"{COLOR} (5 sensor_msgs/msg/Image in frame '{FRAME}')" in dut.listing()

    import_ros_bag(tmp_path / "ros1.bag", tmp_path / "demo.mcap", cameras=CAMERAS)

    check_small_frames(load_demonstration(tmp_path / "demo.mcap"), recording)


def test_images_keep_their_encoding(tmp_path):
    def jpeg(rgb, stamp, frame):
        data = cv2.imencode(".jpg", rgb[..., ::-1])[1].tobytes()
        return compressed_image("rgb8; jpeg compressed bgr8", data, stamp, frame)

    recording = RosRecording.of_small_frames(color=jpeg)
    recording.rename(COLOR, f"{COLOR}/compressed")

    load(recording, tmp_path)

    with (tmp_path / "demo.mcap").open("rb") as stream:
        messages = list(make_reader(stream).iter_messages(topics=["/camera/left/image"]))
    sent = [m for m in recording.messages if m[0] == f"{COLOR}/compressed"]
    assert len(messages) == len(sent) == 5
    for (schema, _, got), (_, log_time, _, content) in zip(messages, sent, strict=True):
        assert schema.name == "foxglove.CompressedImage"
        assert got.log_time == log_time
        dut = CompressedImage.FromString(got.data)
        assert (dut.data, dut.format) == (content["data"], content["format"])
        assert dut.timestamp.ToNanoseconds() == log_time - 10_000_000


@pytest.mark.parametrize("make", [compressed_depth, compressed_float_depth])
def test_compressed_depth(tmp_path, make):
    recording = RosRecording.of_small_frames(depth=make)
    recording.rename(DEPTH, f"{DEPTH}/compressedDepth")

    dut = load(recording, tmp_path).frames[2].images[0].depth

    # Quantized inverse depth has steps of 0.2 mm at 0.8 m.
    np.testing.assert_allclose(dut, image(2, stamp=0.0).depth, atol=0.8e-3)


def test_lenses_are_removed(recording, tmp_path):
    lens = np.array([-0.2, 0.05, 0.001, -0.002, 0.0])
    recording.edit(INFO, lambda info: info | {"d": lens.tolist()})

    dut = load(recording, tmp_path).frames[2].images[0]

    wanted = image(2, stamp=0.0)
    # OpenCV rounds coordinates to 1/32 pixel in `undistort`.
    np.testing.assert_allclose(dut.rgb, cv2.undistort(wanted.rgb, K, lens), atol=1)
    # Where the lens sends the ray of a pixel.
    u, v = 3, 20
    ray = np.linalg.solve(K, [u, v, 1.0])
    seen = cv2.projectPoints(ray[None], np.zeros(3), np.zeros(3), K, lens)[0].ravel()
    column, row = np.rint(seen).astype(int)
    assert (row, column) != (v, u)
    assert dut.depth[v, u] == pytest.approx(wanted.depth[row, column], abs=0.6e-3)


def test_rectified_images_have_the_intrinsics_in_p(recording, tmp_path):
    P = np.hstack([np.diag([25.0, 25.0, 1.0]), np.zeros((3, 1))])
    recording.edit(INFO, lambda info: info | {"d": [0.1] * 5, "p": P.ravel().tolist()})
    recording.rename(COLOR, "/left/color/image_rect_color")

    dut = load(recording, tmp_path)

    np.testing.assert_array_equal(dut.cameras[0].K, P[:, :3])
    np.testing.assert_array_equal(dut.frames[1].images[0].rgb, image(1, stamp=0.0).rgb)


def test_a_calibration_is_written_once_and_on_change(recording, tmp_path):
    def changed(info):
        late = info["header"]["stamp"]["nanosec"] >= 250_000_000
        return info | {"k": [40.0, *info["k"][1:]]} if late else info

    recording.edit(INFO, changed)

    dut = load(recording, tmp_path)

    assert [frame.cameras[0].K[0, 0] for frame in dut.frames] == [30.0, 30.0, 40.0, 40.0, 40.0]
    with (tmp_path / "demo.mcap").open("rb") as stream:
        counts = Counter(channel.topic for _, channel, _ in make_reader(stream).iter_messages())
    assert (counts["/camera/left/calibration"], counts["/camera/right/calibration"]) == (2, 1)


def raw_depth(recording: RosRecording) -> None:
    """Puts the left depth camera 15 mm beside the colour camera, with other intrinsics."""
    frame, X_CD = "left_depth_optical_frame", np.eye(4)
    X_CD[0, 3] = 0.015
    recording.add("/tf_static", 0, transforms(recording.start, (FRAME, frame, X_CD)))
    recording.set_frame(DEPTH, frame)
    recording.rename(DEPTH, "/left/depth/image_rect_raw")
    K_D = K * [[0.8], [0.8], [1.0]]
    info = camera_info(K_D, (WIDTH, HEIGHT), recording.start, frame)
    recording.add("/left/depth/camera_info", 0, info)
    # A wall at 0.6 m.
    wall = np.full((HEIGHT, WIDTH), 600, dtype="<u2").tobytes()
    recording.edit("/left/depth/image_rect_raw", lambda old: old | {"data": wall})


@pytest.mark.parametrize("posed", [False, True])
@pytest.mark.parametrize("named", [False, True])
def test_raw_depth_is_registered(recording, tmp_path, posed, named):
    raw_depth(recording)
    if not named:  # The frames are those of the images.
        for topic in (INFO, "/left/depth/camera_info"):
            recording.set_frame(topic, "")
    poses = {name: camera(name).X_WC for name in ("left", "right")} if posed else None

    dut = load(recording, tmp_path, poses=poses)

    # At 0.6 m, the depth camera sees more than the colour camera on all sides.
    depth = dut.frames[2].images[0].depth
    np.testing.assert_allclose(depth[2:-2, 2:-2], 0.6, atol=1e-6)
    np.testing.assert_allclose(dut.cameras[0].X_WC, camera("left").X_WC, atol=1e-12)


def test_labels_come_along(recording, tmp_path):
    for name in ("left", "right"):
        label = image(0, stamp=0.0, labelled=True).label.astype(np.uint8)
        frame = f"{name}_color_optical_frame"
        message = raw_image("mono8", label, recording.start, frame)
        recording.add(f"/{name}/segmentation/mask", 40_000_000, message)

    dut = load(recording, tmp_path, label_ids={"mug": [3, 4], "mug/handle": [4]}).frames[0]

    assert dut.label_ids == {"mug": (3, 4), "mug/handle": (4,)}
    np.testing.assert_array_equal(dut.images[1].label, image(0, stamp=0.0, labelled=True).label)


def test_another_frame_can_be_the_world(recording, tmp_path):
    X_WB = np.eye(4)
    X_WB[:3, 3] = [0.1, -0.2, 0.75]
    message = transforms(recording.start, ("world", "panda_link0", X_WB))
    recording.add("/tf_static", 0, message)

    dut = load(recording, tmp_path, world="/panda_link0")

    wanted = np.linalg.inv(X_WB) @ camera("left").X_WC
    np.testing.assert_allclose(dut.cameras[0].X_WC, wanted, atol=1e-12)


def test_given_poses_replace_the_transforms(recording, tmp_path):
    # As with drivers that were all started with the default name.
    for topic in (INFO, INFO.replace("left", "right")):
        recording.set_frame(topic, "color_frame")
    poses = {"left": camera("over there").X_WC, "right": camera("elsewhere").X_WC}

    dut = load(recording, tmp_path, poses=poses)

    for model in dut.cameras:
        np.testing.assert_allclose(model.X_WC, poses[model.name], atol=1e-15)


def test_images_without_stamps_use_the_times_of_logging(recording, tmp_path):
    for topic in {message[0] for message in recording.messages} - {"/tf_static"}:
        recording.edit(topic, lambda old: old | {"header": header(0, old["header"]["frame_id"])})

    dut = load(recording, tmp_path)

    np.testing.assert_allclose(dut.stamps, recording.start / 1e9 + 0.01 + np.arange(5) / 8)


def test_the_start_and_the_end_can_be_left_out(recording, tmp_path):
    dut = load(recording, tmp_path, start=0.1, end=0.3)

    np.testing.assert_array_equal(dut.stamps, recording.start / 1e9 + np.array([0.125, 0.25]))
    np.testing.assert_array_equal(dut.frames[1].images[1].rgb, image(2, stamp=0.25).rgb)
