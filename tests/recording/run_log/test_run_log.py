import json
import threading

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.message_encoder import MessageEncoder
from poil_drake.recording.run_log import writer
from poil_drake.recording.run_log.writer import RunLogConfig, RunLogWriter


class Log:
    """A run log as a plain MCAP reader sees it."""

    def __init__(self, path):
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            self.metadata = {}
            for record in reader.iter_metadata():
                self.metadata |= record.metadata
            self.attachments = {a.name: a.data for a in reader.iter_attachments()}
            self.messages = {}
            self.schemas = {}
            for schema, channel, message in reader.iter_messages():
                if channel.message_encoding == "json":
                    value = json.loads(message.data)
                else:
                    value = DecoderFactory().decoder_for("protobuf", schema)(message.data)
                self.messages.setdefault(channel.topic, []).append((message.log_time, value))
                self.schemas[channel.topic] = (schema.name, schema.encoding)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out" / "run.mcap"


def write_everything(dut, time):
    dut.write_image("left", np.full((24, 32, 3), 90, np.uint8), time=time, stamp=time - 0.0625)
    dut.write_depth("left", np.full((24, 32), 0.5, np.float32), time=time)
    dut.write_points("tracked", np.eye(3), time=time, confidence=np.ones(3))
    dut.write_transform(np.eye(4), child="gripper", time=time)
    dut.write_joint_states(["j1", "j2"], time=time, position=np.array([0.1, 0.2]))
    dut.write_twist("/controller/twist", np.arange(6.0), time=time)
    dut.write_status("/controller/status", {"code": 2, "tau": np.array([0.5, np.nan])}, time=time)
    dut.write_phase("EXECUTE", time=time, reason="grasped")


def test_every_kind_of_message_is_read_back(path):
    with RunLogWriter(path, metadata={"seed": "3"}, scenario_text="A: {}") as dut:
        write_everything(dut, 0.125)
        write_everything(dut, 0.25)

    log = Log(path)

    assert log.schemas == {
        "/camera/left/image": ("foxglove.CompressedImage", "protobuf"),
        "/camera/left/depth": ("foxglove.RawImage", "protobuf"),
        "/points/tracked": ("foxglove.PointCloud", "protobuf"),
        "/tf": ("foxglove.FrameTransform", "protobuf"),
        "/robot/joint_states": ("foxglove.JointStates", "protobuf"),
        "/controller/twist": ("poil.Twist", "jsonschema"),
        "/controller/status": ("poil.controller.status", "jsonschema"),
        "/phase": ("poil.phase", "jsonschema"),
    }
    assert all([time for time, _ in m] == [125000000, 250000000] for m in log.messages.values())
    assert log.metadata["seed"] == "3"
    assert log.attachments == {"scenario.yaml": b"A: {}"}


def test_values_are_those_written(path):
    with RunLogWriter(path) as dut:
        write_everything(dut, 0.125)
        dut.write_points("target", np.array([[1, 2, 3], [np.nan] * 3]), time=0.5)

    messages = {topic: values[0][1] for topic, values in Log(path).messages.items()}

    image = messages["/camera/left/image"]
    assert image.timestamp.ToNanoseconds() == 62_500_000
    pixels = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(pixels.astype(int) - 90).max() <= 1
    cloud = messages["/points/tracked"]
    assert [f.name for f in cloud.fields] == ["x", "y", "z", "confidence"]
    values = np.frombuffer(cloud.data, "<f4").reshape(3, 4)
    np.testing.assert_array_equal(values, np.column_stack([np.eye(3), np.ones(3)]))
    assert cloud.frame_id == "world"
    assert cloud.pose.orientation.w == 1.0
    target = np.frombuffer(messages["/points/target"].data, "<f4").reshape(2, 3)
    np.testing.assert_array_equal(target, [[1, 2, 3], [np.nan] * 3])
    joints = messages["/robot/joint_states"].joints
    assert [(j.name, j.position) for j in joints] == [("j1", 0.1), ("j2", 0.2)]
    assert not joints[0].HasField("velocity")
    assert messages["/controller/twist"]["linear"] == {"x": 3.0, "y": 4.0, "z": 5.0}
    assert messages["/controller/status"]["tau"] == [0.5, None]
    timestamp = {"sec": 0, "nsec": 125_000_000}
    expected = {"timestamp": timestamp, "phase": "EXECUTE", "reason": "grasped"}
    assert messages["/phase"] == expected


def test_a_log_is_readable_after_an_exception(path):
    def run():
        with RunLogWriter(path) as dut:
            write_everything(dut, 0.125)
            raise RuntimeError("the robot has gone")

    with pytest.raises(RuntimeError, match="robot"):
        run()

    assert len(Log(path).messages) == 8


def test_arrays_may_be_changed_after_writing(path):
    points = np.ones((50, 3))
    with RunLogWriter(path) as dut:
        for i in range(20):
            points[:] = i
            dut.write_points("tracked", points, time=i / 8)

    for i, (_, cloud) in enumerate(Log(path).messages["/points/tracked"]):
        np.testing.assert_array_equal(np.frombuffer(cloud.data, "<f4"), np.full(150, i))


def test_a_full_queue_may_drop_messages_and_reports_it(path, monkeypatch):
    monkeypatch.setattr(writer, "_BATCHES", 1)
    monkeypatch.setattr(writer, "_BATCH", 2)
    gate, started = threading.Event(), threading.Event()

    def slow(X, **named):
        started.set()
        gate.wait()
        return MessageEncoder().transform(X, parent="world", child="a", **named)

    with RunLogWriter(path, config=RunLogConfig(drop_when_full=True)) as dut:
        # Two messages wait as one batch.
        dut._write("/tf", slow, np.eye(4), time=0.0)
        dut._write("/tf", slow, np.eye(4), time=0.0)
        started.wait()
        for i in range(5):
            dut.write_phase(str(i), time=i / 8)
        gate.set()

    log = Log(path)
    assert log.metadata["dropped_messages"] == "2"
    assert [value["phase"] for _, value in log.messages["/phase"]] == ["0", "1", "4"]


def test_an_error_while_writing_reaches_the_caller(path):
    dut = RunLogWriter(path)
    dut.write_status("/phase", {"a": 1}, time=0.0)
    dut.write_transform(np.eye(4), child="a", time=0.0)
    dut._submit(lambda: (_ for _ in ()).throw(OSError("disk full")))

    with pytest.raises(OSError, match="disk full"):
        dut.close()

    assert set(Log(path).messages) == {"/phase", "/tf"}


def test_closing_twice_does_nothing(path):
    dut = RunLogWriter(path)
    dut.write_phase("IDLE", time=0.0)
    dut.close()
    dut.close()

    assert list(Log(path).messages) == ["/phase"]


def test_negative_times_are_refused(path):
    with RunLogWriter(path) as dut, pytest.raises(InvalidValueError, match="not negative"):
        dut.write_phase("IDLE", time=-1.0)


def test_a_topic_holds_one_type_of_message(path):
    dut = RunLogWriter(path)
    dut.write_phase("IDLE", time=0.0)
    dut.write_twist("/phase", np.zeros(6), time=0.0)

    with pytest.raises(InvalidValueError, match="Topic /phase holds"):
        dut.close()


def test_the_same_run_gives_the_same_file(tmp_path):
    for name in ("a", "b"):
        with RunLogWriter(tmp_path / name) as dut:
            for i in range(5):
                write_everything(dut, 0.125 * (i + 1))

    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_plan_and_labels_are_kept(path):
    label = np.arange(24 * 32, dtype=np.int16).reshape(24, 32)
    with RunLogWriter(path, scenario_text="A: {}", plan=b"a plan") as dut:
        dut.write_label_ids({"mug": (1, 2), "mug/handle": (2,)})
        dut.write_label("left", label, time=0.25, stamp=0.125)

    log = Log(path)
    assert log.attachments == {"scenario.yaml": b"A: {}", "plan.npz": b"a plan"}
    assert json.loads(log.metadata["label_ids"]) == {"mug": [1, 2], "mug/handle": [2]}
    ((time, message),) = log.messages["/camera/left/label"]
    assert (time, message.timestamp.ToNanoseconds()) == (250_000_000, 125_000_000)
    np.testing.assert_array_equal(np.frombuffer(message.data, "<i2").reshape(24, 32), label)


def test_depth_and_points_may_be_exact(path):
    depth, points = np.full((24, 32), 0.12345678, np.float32), np.full((2, 3), 0.1)
    with RunLogWriter(path, config=RunLogConfig(exact_depth=True)) as dut:
        dut.write_depth("left", depth, time=0.25)
        dut.write_points("tracked", points, time=0.25, exact=True)

    messages = {topic: values[0][1] for topic, values in Log(path).messages.items()}
    image, cloud = messages["/camera/left/depth"], messages["/points/tracked"]
    assert image.encoding == "32FC1"
    np.testing.assert_array_equal(np.frombuffer(image.data, "<f4").reshape(24, 32), depth)
    np.testing.assert_array_equal(np.frombuffer(cloud.data, "<f8").reshape(2, 3), points)


def test_images_may_be_left_out(path):
    with RunLogWriter(path, config=RunLogConfig(images=False)) as dut:
        dut.write_image("left", np.zeros((24, 32, 3), np.uint8), time=0.25)
        dut.write_depth("left", np.zeros((24, 32), np.float32), time=0.25)
        dut.write_label("left", np.zeros((24, 32), np.int16), time=0.25)

    assert Log(path).messages == {}
