import threading
import time

import numpy as np
import pytest
from mcap.reader import make_reader
from small_frames import camera, image

from poil_drake.recording.demonstration import live_recorder
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.live_recorder import (
    LABEL_WAIT,
    CameraRecord,
    LiveRecorder,
)
from poil_drake.recording.demonstration.writer import DemonstrationWriter
from poil_drake.runtime.output_files import OutputError

NAMES = ("right", "left")
FPS = 30.0


@pytest.fixture
def path(tmp_path):
    return tmp_path / "demo.mcap"


@pytest.fixture
def dut(path):
    return LiveRecorder(path, [camera(name) for name in NAMES], {})


def add_images(dut, camera, *stamps):
    """Records an image at each of these stamps [s]."""
    dut.start()
    for k, stamp in enumerate(stamps):
        dut.add(camera, image(k, stamp=stamp))


def test_images_of_two_threads_come_back_with_their_own_stamps(path):
    cameras = [camera(name) for name in NAMES]
    options = {"lossless": True, "label_ids": {"mug": (3,)}, "scenario_text": "HangMug: {}"}
    dut = LiveRecorder(path, cameras, {"seed": "7"}, **options)
    shift = {"right": 0.0, "left": 0.004}

    def sent(k, name):
        return image(k, stamp=1.7e9 + k / FPS + shift[name], labelled=k % 2 == 0)

    def deliver(name):
        for k in range(60):
            dut.add(name, sent(k, name))

    dut.start()
    threads = [threading.Thread(target=deliver, args=[name]) for name in NAMES]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    dut.close()
    dut.close()

    loaded = load_demonstration(path)
    assert len(loaded.frames) == 60
    assert [model.name for model in loaded.cameras] == list(NAMES)
    assert (loaded.metadata["seed"], loaded.scenario_text) == ("7", "HangMug: {}")
    for k, frame in enumerate(loaded.frames):
        for name, found in zip(NAMES, frame.images, strict=True):
            wanted = sent(k, name)
            assert abs(found.stamp - wanted.stamp) < 1e-6
            np.testing.assert_array_equal(found.rgb, wanted.rgb)
            np.testing.assert_array_equal(found.depth, wanted.depth)
            assert (found.label is None) == (wanted.label is None)
    assert loaded.frames[0].label_ids == {"mug": (3,)}


def test_only_images_between_start_and_close_are_recorded(dut, path):
    dut.add("left", image(0, stamp=1.0))
    assert not path.exists()

    add_images(dut, "left", 2.0, 3.0, 4.0)
    dut.close()
    dut.add("left", image(0, stamp=5.0))

    assert dut.records["left"].stamps == [2.0, 3.0, 4.0]
    assert dut.records["left"].rate == pytest.approx(1.0)
    assert dut.records["right"].stamps == []
    with path.open("rb") as stream:
        statistics = make_reader(stream).get_summary().statistics
    # A calibration, and the pose, colour and depth of each image.
    assert statistics.message_count == 1 + 3 * 3


def test_a_clock_that_went_back_costs_images_that_are_counted(dut):
    dut.add("left", image(0, stamp=100.0))
    dut.add("left", image(0, stamp=1.0))  # Before the start, it costs nothing.
    add_images(dut, "left", 2.0, 3.0, 2.5, 3.0, 4.0)
    dut.close()

    record = dut.records["left"]
    assert (record.stamps, record.late, record.lost) == ([2.0, 3.0, 4.0], 2, 0)


@pytest.mark.parametrize(
    ("labels", "first"),
    [
        ({0: True, 3: True}, 3),  # Labels were seen before the start, at 1.
        ({3: True}, 1),  # None were seen.
        ({0: True}, 4),  # No more come.
    ],
)
def test_a_recording_begins_with_labels_if_the_camera_sends_them(dut, labels, first):
    for k in range(6):
        if k == 1:
            dut.start()
        dut.add("left", image(k, stamp=k * LABEL_WAIT / 2.5, labelled=labels.get(k, False)))
    dut.close()

    assert dut.records["left"].stamps == [k * LABEL_WAIT / 2.5 for k in range(first, 6)]


def test_images_that_a_slow_disk_cannot_take_are_counted(dut, monkeypatch):
    go_on = threading.Event()
    write_messages = DemonstrationWriter.write_messages

    def write_slowly(*args, **stamp):
        go_on.wait()
        write_messages(*args, **stamp)

    monkeypatch.setattr(DemonstrationWriter, "write_messages", write_slowly)
    monkeypatch.setattr(live_recorder, "_WAITING", 4)
    add_images(dut, "left", *range(20))
    go_on.set()
    dut.close()

    record = dut.records["left"]
    # The thread may have taken one image from the queue of four.
    assert len(record.stamps) in (4, 5)
    assert len(record.stamps) + record.lost == 20
    assert record.stamps == list(range(len(record.stamps)))


def test_after_an_error_images_are_counted_as_lost_and_the_rest_stays_readable(
    dut, path, monkeypatch
):
    dut.start()
    for k in range(120):
        for name in NAMES:
            dut.add(name, image(k, stamp=k / FPS))
    while len(dut.records[NAMES[-1]].stamps) < 120 and dut.error is None:
        time.sleep(0.001)

    def fail(*args, **message):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("poil_drake.recording.mcap.sink.Writer.add_message", fail)
    dut.add("left", image(0, stamp=1000.0))
    dut.add("left", image(0, stamp=1001.0))
    dut.close()

    assert isinstance(dut.error, OSError)
    assert dut.records["left"].lost == 2
    assert path.read_bytes()[-8:] != b"\x89MCAP0\r\n"
    assert len(load_demonstration(path).frames) > 80


def test_a_file_that_exists_is_not_touched(dut, path):
    path.write_text("old")

    with pytest.raises(OutputError, match=r"demo\.mcap' exists already"):
        dut.start()

    assert path.read_text() == "old"


@pytest.mark.parametrize(
    ("stamps", "count"),
    [
        ([], 0),
        ([1.0], 0),
        ([1.0, 9.0], 0),
        ([0.0, 0.1, 0.2, 0.3], 0),
        ([0.0, 0.1, 0.2, 0.4, 0.5, 0.9, 1.0], 4),
        ([0.0, 0.09, 0.21, 0.3, 0.41], 0),  # Jitter.
    ],
)
def test_gaps_between_stamps_count_as_missing_images(stamps, count):
    assert CameraRecord(stamps).missing == count
