import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from small_frames import make_frame

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.demonstration import Demonstration, load_demonstration
from poil_drake.recording.demonstration.stored_images import RecordedFrames
from poil_drake.recording.demonstration.writer import DemonstrationWriter
from poil_drake.recording.mcap.message_encoder import ColorEncoding

PAGE = Path(__file__).parents[3] / "docs" / "demonstration_format.md"


def write(path, frames, **options):
    with DemonstrationWriter(path, ["left", "right"], {"seed": "7"}, **options) as dut:
        for frame in frames:
            dut.write(frame)


@pytest.fixture
def record(tmp_path):
    def record_(count=5, labelled=lambda i: False, height=lambda i: 0.6, **kwargs):
        path = tmp_path / "demo.mcap"
        frames = [make_frame(i, labelled=labelled(i), height=height(i)) for i in range(count)]
        write(path, frames, **kwargs)
        return path, frames

    return record_


def test_depth_comes_back_to_half_a_millimetre(record):
    path, frames = record()

    for loaded, written in zip(load_demonstration(path).frames, frames, strict=True):
        for a, b in zip(loaded.images, written.images, strict=True):
            assert np.abs(a.depth - b.depth).max() <= 0.5e-3 + 1e-6
            np.testing.assert_array_equal(a.depth == 0.0, b.depth == 0.0)


# JPEG at quality 95 quantizes a smooth picture by about one grey level.
@pytest.mark.parametrize(("format_", "tolerance"), [("raw", 0.0), ("png", 0.0), ("jpeg", 2.0)])
def test_colour_comes_back_as_its_format_allows(record, format_, tolerance):
    path, frames = record(color=ColorEncoding(format=format_))

    for loaded, written in zip(load_demonstration(path).frames, frames, strict=True):
        difference = loaded.images[1].rgb.astype(float) - written.images[1].rgb
        assert np.abs(difference).mean() <= tolerance


def test_stamps_and_cameras_come_back_exactly(record):
    path, frames = record()

    dut = load_demonstration(path)

    np.testing.assert_array_equal(dut.stamps, [0.0, 0.125, 0.25, 0.375, 0.5])
    assert dut.duration == 0.5
    for loaded, written in zip(dut.cameras, frames[0].cameras, strict=True):
        assert loaded.name == written.name
        assert (loaded.width, loaded.height) == (written.width, written.height)
        np.testing.assert_array_equal(loaded.K, written.K)
        np.testing.assert_allclose(loaded.X_WC, written.X_WC, atol=1e-15)


def test_labels_come_back_exactly_where_they_were_written(record):
    path, frames = record(labelled=lambda i: i == 0)

    dut = load_demonstration(path).frames

    np.testing.assert_array_equal(dut[0].images[0].label, frames[0].images[0].label)
    assert dut[0].label_ids == {"mug": (3, 4), "mug/handle": (4,)}
    assert all(image.label is None for frame in dut[1:] for image in frame.images)
    assert dut[1].label_ids == {}


def test_a_moving_camera_keeps_its_poses(record):
    path, _ = record(height=lambda i: 0.6 if i < 3 else 0.7)

    heights = [frame.cameras[0].X_WC[2, 3] for frame in load_demonstration(path).frames]

    np.testing.assert_allclose(heights, [0.6, 0.6, 0.6, 0.7, 0.7])


def test_metadata_and_scenario_come_back(record):
    path, _ = record(scenario_text="HangMug:\n  directives: []\n")

    dut = load_demonstration(path)

    assert dut.scenario_text == "HangMug:\n  directives: []\n"
    assert dut.metadata["seed"] == "7"
    assert json.loads(dut.metadata["cameras"]) == ["left", "right"]
    assert dut.name == str(path)


def test_frames_are_decoded_when_accessed(record):
    path, _ = record()
    dut = load_demonstration(path)

    path.unlink()

    # Loading decoded the first frame; the others were in the file.
    assert dut.frames[0] is dut.frames[0]
    with pytest.raises(DemonstrationError, match=r"demo\.mcap cannot be read"):
        dut.frames[3]


def test_frames_are_a_sequence(record):
    path, _ = record()
    dut = load_demonstration(path).frames

    assert isinstance(dut, Sequence)
    assert len(dut) == 5
    assert dut[-1].stamp == 0.5
    assert [frame.stamp for frame in dut[1:4:2]] == [0.125, 0.375]
    assert [frame.stamp for frame in reversed(dut)] == [0.5, 0.375, 0.25, 0.125, 0.0]
    with pytest.raises(IndexError):
        dut[5]


def test_only_a_few_frames_are_cached(record):
    path, _ = record(count=12)
    dut = load_demonstration(path).frames

    first = dut[0]
    assert isinstance(dut, RecordedFrames)
    assert [f.stamp for f in dut] == [i / 8 for i in range(12)]
    assert dut[0] is not first


def test_cameras_can_be_chosen(record):
    path, _ = record()

    dut = load_demonstration(path, cameras=["right"])

    assert [camera.name for camera in dut.cameras] == ["right"]


def test_a_demonstration_can_be_made_of_frames():
    dut = Demonstration([make_frame(i) for i in range(3)])

    assert dut.duration == 0.25
    with pytest.raises(DemonstrationError, match="needs at least 2 frames in which"):
        Demonstration([make_frame(0)])


def test_topics_and_schemas_are_those_of_the_documentation(tmp_path):
    rows = re.findall(r"^\| `(/\S+)` \| `(foxglove\.\w+)`", PAGE.read_text(), re.MULTILINE)
    documented = {
        (topic.replace("<name>", name), schema)
        for topic, schema in rows
        for name in ("left", "right")
    }

    write(tmp_path / "demo.mcap", [make_frame(0, labelled=True), make_frame(1)])

    with (tmp_path / "demo.mcap").open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
        written = {
            (channel.topic, summary.schemas[channel.schema_id].name)
            for channel in summary.channels.values()
        }
        assert {channel.message_encoding for channel in summary.channels.values()} == {"protobuf"}
    assert written == documented


def test_messages_are_logged_at_the_time_of_capture(tmp_path):
    write(tmp_path / "demo.mcap", [make_frame(i) for i in range(3)])

    with (tmp_path / "demo.mcap").open("rb") as stream:
        messages = [m for _, _, m in make_reader(stream).iter_messages("/camera/left/depth")]
    assert [m.log_time for m in messages] == [0, 125_000_000, 250_000_000]
    assert [m.publish_time for m in messages] == [0, 125_000_000, 250_000_000]


def test_a_recording_that_fails_leaves_nothing(tmp_path):
    def frames():
        yield make_frame(0)
        yield make_frame(1)
        raise RuntimeError("unplugged")

    with pytest.raises(RuntimeError, match="unplugged"):
        write(tmp_path / "demo.mcap", frames())

    assert list(tmp_path.iterdir()) == []


def test_an_older_file_survives_a_recording_that_fails(tmp_path):
    path = tmp_path / "demo.mcap"
    path.write_text("older")

    with pytest.raises(DemonstrationError, match="needs at least 2 frames, but has 1"):
        write(path, [make_frame(0)])

    assert path.read_text() == "older"


def test_frames_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(DemonstrationError, match="cameras"):
        write(tmp_path / "demo.mcap", [make_frame(0, names=("left",))])
    with pytest.raises(DemonstrationError, match=r"at 0\.125 s is not later than the previous"):
        write(tmp_path / "demo.mcap", [make_frame(1), make_frame(1)])


def test_the_same_frames_give_the_same_file(tmp_path):
    for name in ("a", "b"):
        write(tmp_path / name, [make_frame(i) for i in range(3)])

    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
