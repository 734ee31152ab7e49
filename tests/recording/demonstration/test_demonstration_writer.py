import re
from pathlib import Path

import pytest
from mcap.reader import make_reader
from small_frames import make_frame

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.writer import DemonstrationWriter

PAGE = Path(__file__).parents[3] / "docs" / "demonstration_format.md"


def record(path, frames):
    with DemonstrationWriter(path, ["left", "right"], {}) as dut:
        for frame in frames:
            dut.write(frame)


def test_topics_and_schemas_are_those_of_the_documentation(tmp_path):
    rows = re.findall(r"^\| `(/\S+)` \| `(foxglove\.\w+)`", PAGE.read_text(), re.MULTILINE)
    documented = {
        (topic.replace("<name>", name), schema)
        for topic, schema in rows
        for name in ("left", "right")
    }

    record(tmp_path / "demo.mcap", [make_frame(0, labelled=True), make_frame(1)])

    with (tmp_path / "demo.mcap").open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
        written = {
            (channel.topic, summary.schemas[channel.schema_id].name)
            for channel in summary.channels.values()
        }
        assert {channel.message_encoding for channel in summary.channels.values()} == {"protobuf"}
    assert written == documented


def test_messages_are_logged_at_the_time_of_capture(tmp_path):
    record(tmp_path / "demo.mcap", [make_frame(i) for i in range(3)])

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
        record(tmp_path / "demo.mcap", frames())

    assert list(tmp_path.iterdir()) == []


def test_an_older_file_survives_a_recording_that_fails(tmp_path):
    path = tmp_path / "demo.mcap"
    path.write_text("older")

    with pytest.raises(DemonstrationError, match="needs at least 2 frames, but has 1"):
        record(path, [make_frame(0)])

    assert path.read_text() == "older"


def test_frames_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(DemonstrationError, match="cameras"):
        record(tmp_path / "demo.mcap", [make_frame(0, names=("left",))])
    with pytest.raises(DemonstrationError, match=r"at 0\.125 s is not later than the previous"):
        record(tmp_path / "demo.mcap", [make_frame(1), make_frame(1)])


def test_the_same_frames_give_the_same_file(tmp_path):
    for name in ("a", "b"):
        record(tmp_path / name, [make_frame(i) for i in range(3)])

    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
