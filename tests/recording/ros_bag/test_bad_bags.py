"""Bags that are damaged, or make no demonstration, are refused in one clear line."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ros_bags import RosRecording, transforms

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.ros_bag.bag import RosBag
from poil_drake.recording.ros_bag.bag_import import import_ros_bag

COLOR, DEPTH = "/left/color/image_raw", "/left/aligned_depth_to_color/image_raw"
INFO = "/left/color/camera_info"


@pytest.fixture
def recording() -> RosRecording:
    return RosRecording.of_small_frames()


def refusal(bag: Path, **options: object) -> str:
    """Returns the message with which an import is refused; it leaves no file."""
    output = bag.with_name("demo.mcap")
    names = sorted(bag.parent.iterdir())
    with pytest.raises(DemonstrationError) as error:
        import_ros_bag(bag, output, **{"cameras": {"left": "/left", "right": "/right"}} | options)
    assert sorted(bag.parent.iterdir()) == names
    return str(error.value)


def test_the_listing_has_topics_types_counts_and_frames(recording, tmp_path):
    recording.add("/chatter", 0, ("std_msgs/msg/String", {"data": "hello"}))

    said = refusal(recording.write_folder(tmp_path / "bag"), cameras={"left": "/lft"})

    assert f"{COLOR} (5 sensor_msgs/msg/Image in frame 'left_color_optical_frame')" in said
    assert "/tf_static (4 tf2_msgs/msg/TFMessage)" in said
    assert "and 1 of other types" in said


def in_one_frame(recording: RosRecording) -> None:
    for topic in (INFO, INFO.replace("left", "right")):
        recording.set_frame(topic, "lens")
    recording.add("/tf_static", 0, transforms(recording.start, ("world", "lens", np.eye(4))))


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (
            lambda dut: dut.drop("/tf_static"),
            [
                "no transform connects frame 'world' with frame 'left_color_optical_frame'",
                "The transforms in the file: none",
                *("--world", "--scenario"),
            ],
        ),
        (in_one_frame, ["the cameras left and right have the same frame, 'lens'"]),
        (
            lambda dut: dut.edit(COLOR, lambda old: old | {"encoding": "yuv422_yuy2"}),
            [
                *("bag.mcap, topic /camera/left/image", "unsupported encoding 'yuv422_yuy2'"),
                f"/camera/left/image is {COLOR}",
            ],
        ),
        (
            lambda dut: dut.edit(DEPTH, lambda old: old | {"is_bigendian": 1}),
            [f"bag.mcap, topic {DEPTH}: an image with encoding '16UC1' is big-endian"],
        ),
        (
            lambda dut: dut.set_frame(DEPTH, "left_depth_frame"),
            ["are in frame 'left_depth_frame'", "/camera/left/depth_calibration"],
        ),
    ],
    ids=["no poses", "one frame", "encoding", "big-endian", "depth beside colour"],
)
def test_refusals_name_the_bag_and_its_topics(recording, tmp_path, edit, words):
    edit(recording)

    said = refusal(recording.write_mcap(tmp_path / "bag.mcap"))

    for word in words:
        assert word in said


def test_frames_without_a_pose_are_named(recording, tmp_path):
    said = refusal(recording.write_mcap(tmp_path / "bag.mcap"), world="panda_link0")

    assert "no transform connects frame 'panda_link0' with frame 'left_color_optical_frame'" in said
    assert "world > left_color_optical_frame, left_link, right_color_optical_frame" in said


def test_a_bag_that_is_not_imported_is_recognized(recording, tmp_path):
    recording.write_db3(tmp_path / "bag")

    for bag in (recording.write_mcap(tmp_path / "bag.mcap"), tmp_path / "bag" / "bag_0.db3"):
        with pytest.raises(DemonstrationError, match="poil demo import"):
            load_demonstration(bag)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("empty.mcap", b"", "seems to be empty"),
        ("text.mcap", b"hello", "cannot be read as a ROS bag"),
        ("text.db3", b"hello", "cannot be read as a ROS bag"),
        ("text.bag", b"hello", "cannot be read as a ROS bag"),
        ("missing.mcap", None, "cannot be read: "),
        ("bag.txt", b"hello", "is not a ROS bag: it is neither a file that ends in .mcap"),
        ("folder/a.txt", b"hello", "is not a ROS bag"),
        ("folder/metadata.yaml", b"[", "cannot be read as a ROS bag"),
        ("folder/metadata.yaml", b"{}", "cannot be read as a ROS bag"),
    ],
)
def test_files_that_are_no_bags(tmp_path, name, content, said):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    if content is not None:
        path.write_bytes(content)

    dut = refusal(tmp_path / name.split("/")[0])

    assert said in dut


@pytest.fixture(scope="module")
def bytes_of_bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder, recording = tmp_path_factory.mktemp("bags"), RosRecording.of_small_frames()
    recording.write_db3(folder / "db3")
    recording.write_mcap(folder / "bag.mcap")
    return {
        "bag.mcap": (folder / "bag.mcap").read_bytes(),
        "bag.db3": (folder / "db3" / "db3_0.db3").read_bytes(),
    }


@given(data=st.data(), name=st.sampled_from(["bag.mcap", "bag.db3"]))
def test_damaged_bags_are_refused_or_read(bytes_of_bags, tmp_path_factory, data, name):
    content = bytearray(bytes_of_bags[name])
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(0, len(content)) | st.just(len(content)))
    path = tmp_path_factory.mktemp("damaged") / name
    path.write_bytes(content[:end])

    with contextlib.suppress(DemonstrationError), RosBag(path) as dut:
        assert len(list(dut.messages(dut.topics))) <= 34


SIZES = st.sampled_from([0, 1, 23, 24, 33, 2**31, 2**32 - 1])
FIELDS = {
    COLOR: {"width": SIZES, "height": SIZES, "step": SIZES, "encoding": st.text(max_size=8)},
    DEPTH: {"width": SIZES, "height": SIZES, "step": SIZES, "data": st.binary(max_size=9)},
    INFO: {
        **{"width": SIZES, "height": SIZES, "distortion_model": st.text(max_size=8)},
        "d": st.lists(st.floats(), max_size=15),
        "k": st.lists(st.floats(), min_size=9, max_size=9),
    },
}
HEADERS = st.builds(
    lambda sec, nanosec, frame: {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame},
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 2**32 - 1),
    st.text(max_size=8),
)


@settings(max_examples=40)
@given(data=st.data(), topic=st.sampled_from(sorted(FIELDS)))
def test_odd_messages_are_refused_or_imported(tmp_path_factory, data, topic):
    recording = RosRecording.of_small_frames()
    fields = FIELDS[topic] | {"header": HEADERS}
    name = data.draw(st.sampled_from(sorted(fields)))
    value = data.draw(fields[name])
    if data.draw(st.booleans()):
        recording.edit(topic, lambda old: old | {name: value})
    else:
        odd = data.draw(st.integers(0, 4))
        numbers = iter(range(5))
        recording.edit(topic, lambda old: old | ({name: value} if next(numbers) == odd else {}))
    bag = recording.write_mcap(tmp_path_factory.mktemp("odd") / "bag.mcap")

    with contextlib.suppress(DemonstrationError):
        import_ros_bag(bag, bag.with_name("demo.mcap"), cameras={"left": "/left"})
        frames = load_demonstration(bag.with_name("demo.mcap")).frames
        for i in range(len(frames)):
            with contextlib.suppress(DemonstrationError):
                _ = frames[i]
