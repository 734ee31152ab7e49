import dataclasses
import json
import math

import numpy as np
import pytest

from poil_drake.errors import RunLogError
from poil_drake.perception.images import CameraModel
from poil_drake.recording.mcap.sink import McapSink
from poil_drake.recording.run_log.reader import load_recorded_run
from poil_drake.recording.run_log.recorded_run import Series
from poil_drake.recording.run_log.writer import RunLogConfig, RunLogWriter

JOINTS = ("j1", "j2")
SIZE = (24, 32)
CAMERA = CameraModel("left", 32, 24, np.diag([30.0, 30.0, 1.0]), np.eye(4))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mcap"


def load(path):
    return load_recorded_run(path, joint_names=JOINTS)


def write_joints(log, time, position=0.0):
    log.write_joint_states(
        JOINTS,
        time=time,
        position=np.array([position, 1.0]),
        velocity=np.array([2.0, 3.0]),
        effort=np.array([4.0, np.nan]),
    )


def test_the_reader_returns_what_was_written(path):
    with RunLogWriter(
        path, metadata={"station": "hardware"}, scenario_text="A: {}", plan=b"plan"
    ) as log:
        write_joints(log, 0.25, position=0.5)
        log.write_joint_states(
            JOINTS, time=0.25, velocity=np.array([0.1, 0.2]), topic="/robot/joint_commands"
        )
        log.write_status(
            "/robot/status", {"mode": 2.0, "age": np.inf, "success_rate": 1.0}, time=0.25
        )
        log.write_status(
            "/hand/status", {"width_commanded": 0.03, "width_measured": 0.04}, time=0.25
        )
        log.write_twist("/controller/twist", np.arange(6.0), time=0.25)
        log.write_phase("wait", time=0.25, reason="begun")
        log.write_points(
            "tracked", np.eye(3), time=0.375, stamp=0.25, confidence=np.ones(3), exact=True
        )
        log.write_status("/cameras/status", {"left.image_time": 0.125}, time=0.25)
        log.write_status("/other/status", {"anything": "goes"}, time=0.25)
        log.write_label_ids({"mug": (1, 2)})
        log.write_calibration(CAMERA, time=0.25)
        log.write_calibration(dataclasses.replace(CAMERA, K=np.eye(3)), time=0.5)
        log.write_transform(np.eye(4), child="gripper", time=0.5)

    run = load(path)

    assert (run.scenario_text, run.plan, run.cut_off) == ("A: {}", b"plan", "")
    assert run.metadata["station"] == "hardware"
    assert run.label_ids == {"mug": (1, 2)}
    assert run.end == 0.25
    np.testing.assert_array_equal(run.joints.at(0.25), [0.5, 1.0, 2.0, 3.0, 4.0, np.nan])
    np.testing.assert_array_equal(run.commands.at(0.25), [0.1, 0.2])
    assert np.isnan(run.postures.at(0.25)).all()
    # No JSON number is infinite.
    status = run.numbers["/robot/status"].at(0.25)
    np.testing.assert_array_equal(status, [2.0, np.nan, 1.0, np.nan])
    np.testing.assert_array_equal(run.numbers["/hand/status"].at(0.25), [0.03, 0.04])
    np.testing.assert_array_equal(run.twist.at(0.25), np.arange(6.0))
    assert run.phases == [(0.25, "wait", "begun")]
    (logged,) = run.tracks
    assert (logged.time, logged.track.stamp) == (0.375, 0.25)
    np.testing.assert_array_equal(logged.track.positions, np.eye(3))
    assert run.camera_times["left"].at(0.3)[0] == 0.125
    # The first of two.
    np.testing.assert_array_equal(run.calibrations["left"].K, CAMERA.K)
    np.testing.assert_array_equal(run.camera_poses["left"], np.eye(4))
    assert list(run.camera_poses) == ["left"]


def write_images(log, time, *, label=None):
    log.write_image("left", np.full((*SIZE, 3), 90, np.uint8), time=time, stamp=time - 0.125)
    log.write_depth("left", np.full(SIZE, 0.5, np.float32), time=time, stamp=time - 0.125)
    if label is not None:
        pixels = np.full(SIZE, label, np.int16)
        log.write_label("left", pixels, time=time + 0.5, stamp=time - 0.125)


def test_images_are_decoded_when_they_are_read(path):
    with RunLogWriter(path) as log:
        write_images(log, 0.25)
        write_images(log, 0.5, label=7)
        log.write_image("left", np.zeros((*SIZE, 3), np.uint8), time=0.75)  # Without depth.

    run = load(path)
    read = run.image_reader(CAMERA)

    assert [image.time for image in run.images["left"]] == [0.25, 0.5]
    assert [read(k).stamp for k in (0, 1)] == [0.125, 0.375]
    assert read(0).label is None
    # Logged half a second later.
    np.testing.assert_array_equal(read(1).label, np.full(SIZE, 7))
    np.testing.assert_array_equal(read(1).depth, np.full(SIZE, np.float32(0.5)))
    assert np.abs(read(1).rgb.astype(int) - 90).max() <= 1
    assert read(1) is read(1)


def test_images_of_another_size_are_refused(path):
    with RunLogWriter(path) as log:
        write_images(log, 0.25)
    other = CameraModel("left", 16, 12, CAMERA.K, np.eye(4))

    with pytest.raises(RunLogError, match="32 x 24 pixels instead of 16 x 12"):
        load(path).image_reader(other)(0)


def test_a_log_that_is_cut_off_is_read_up_to_there(path):
    with RunLogWriter(path, config=RunLogConfig(chunk_size=1 << 12)) as log:
        for k in range(400):
            write_joints(log, k / 256, position=np.sin(k))
    path.write_bytes(path.read_bytes()[:-12_000])

    run = load(path)

    assert "is cut off" in run.cut_off
    assert 10 < len(run.joints) < 400
    assert run.end == (len(run.joints) - 1) / 256


def test_other_files_are_refused(path):
    path.write_bytes(b"%PDF-1.7 and so on")

    with pytest.raises(RunLogError, match="is not an MCAP file") as caught:
        load(path)

    assert "demonstration" not in caught.value.remedy


def test_a_damaged_log_is_refused(path):
    with RunLogWriter(path) as log:
        for k in range(100):
            write_joints(log, k / 256)
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(bytes(data))

    with pytest.raises(RunLogError, match="is damaged"):
        load(path)


@pytest.mark.parametrize(
    ("topic", "value", "problem"),
    [
        ("/robot/status", {"mode": "fast"}, "'fast' instead of a number"),
        ("/robot/status", {"mode": True}, "True instead of a number"),
        ("/robot/status", {"mode": 10**400}, "damaged"),
        ("/controller/twist", {"angular": 3}, "damaged"),
        ("/controller/twist", {}, "damaged"),
        ("/phase", {"phase": "wait"}, "damaged"),
        ("/robot/joint_states", {}, "the topic holds 'any' messages encoded as 'json'"),
        ("/points/tracked", {}, "the topic holds 'any' messages encoded as 'json'"),
        ("/camera/left/image", {}, "the topic holds 'any' messages encoded as 'json'"),
    ],
)
def test_other_messages_than_a_run_writes_are_refused(path, topic, value, problem):
    sink = McapSink(path.open("wb"))
    sink.write_json(topic, value, schema="any", time=0)
    sink.close()

    with pytest.raises(RunLogError, match=problem) as caught:
        load(path)

    assert f"topic {topic}" in str(caught.value)


def test_a_message_that_is_nested_too_deeply_is_refused(path):
    sink = McapSink(path.open("wb"))
    sink.write_json("/phase", {}, schema="any", time=0)
    writer, channel = sink._writer, sink._channels["/phase"][0]
    writer.add_message(channel, 0, b"[" * 100_000, 0)
    sink.close()

    with pytest.raises(RunLogError, match="topic /phase"):
        load(path)


@pytest.mark.parametrize(
    "text", ["[1]", "{", json.dumps({"mug": 3}), json.dumps({"mug": ["a"]}), '{"a": [Infinity]}']
)
def test_other_label_ids_are_refused(path, text):
    with RunLogWriter(path, metadata={"label_ids": text}):
        pass

    with pytest.raises(RunLogError, match="label_ids"):
        _ = load(path).label_ids


def test_the_newest_sample_by_a_time_is_found():
    dut = Series.of([(0.0, [1.0]), (0.25, [2.0]), (0.5, [3.0])], 1)

    found = [dut.at(time)[0] for time in (-0.1, 0.0, 0.2, 0.25, 0.49, 7.0)]

    np.testing.assert_array_equal(found, [np.nan, 1.0, 1.0, 2.0, 2.0, 3.0])


def test_an_empty_series_has_no_sample():
    assert np.isnan(Series.of([], 3).at(0.5)).tolist() == [True] * 3


def test_a_time_that_was_rounded_to_nanoseconds_is_the_same():
    third = round(1e9 / 3) / 1e9

    assert Series.of([(third, [1.0])], 1).at(1 / 3)[0] == 1.0


def test_samples_are_put_in_order():
    dut = Series.of([(0.5, [2.0]), (0.0, [1.0])], 1)

    np.testing.assert_array_equal(dut.times, [0.0, 0.5])
    np.testing.assert_array_equal(dut.values, [[1.0], [2.0]])


@pytest.mark.parametrize(("times", "period"), [([0.0, 0.1, 0.2, 9.0], 0.1), ([1.0], math.nan)])
def test_the_period_is_the_median(times, period):
    dut = Series.of([(time, [0.0]) for time in times], 1)

    assert dut.period == pytest.approx(period, nan_ok=True)
