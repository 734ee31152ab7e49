import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

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
def make(tmp_path: Path) -> Callable[..., LiveRecorder]:
    def make_(**options: object) -> LiveRecorder:
        cameras = [camera(name) for name in NAMES]
        return LiveRecorder(tmp_path / "demo.mcap", cameras, {"seed": "7"}, **options)  # type: ignore[arg-type]

    return make_


def test_images_of_two_threads_come_back_with_their_own_stamps(
    make: Callable[..., LiveRecorder], tmp_path: Path
) -> None:
    dut = make(lossless=True, label_ids={"mug": (3,)}, scenario_text="HangMug: {}")
    shift = {"right": 0.0, "left": 0.004}

    def deliver(name: str) -> None:
        for k in range(60):
            dut.add(name, image(k, stamp=1.7e9 + k / FPS + shift[name], labelled=k % 2 == 0))

    dut.start()
    threads = [threading.Thread(target=deliver, args=[name]) for name in NAMES]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    dut.close()
    dut.close()

    loaded = load_demonstration(tmp_path / "demo.mcap")
    assert len(loaded.frames) == 60
    assert [model.name for model in loaded.cameras] == list(NAMES)
    assert (loaded.metadata["seed"], loaded.scenario_text) == ("7", "HangMug: {}")
    for k, frame in enumerate(loaded.frames):
        for name, found in zip(NAMES, frame.images, strict=True):
            sent = image(k, stamp=1.7e9 + k / FPS + shift[name], labelled=k % 2 == 0)
            assert abs(found.stamp - sent.stamp) < 1e-6
            np.testing.assert_array_equal(found.rgb, sent.rgb)
            np.testing.assert_array_equal(found.depth, sent.depth)
            assert (found.label is None) == (sent.label is None)
    assert loaded.frames[0].label_ids == {"mug": (3,)}


def test_only_images_between_start_and_close_are_recorded(
    make: Callable[..., LiveRecorder], tmp_path: Path
) -> None:
    dut = make()
    dut.add("left", image(0, stamp=1.0))
    assert not (tmp_path / "demo.mcap").exists()

    dut.start()
    for stamp in (2.0, 3.0, 4.0):
        dut.add("left", image(0, stamp=stamp))
    dut.close()
    dut.add("left", image(0, stamp=5.0))

    assert dut.records["left"].stamps == [2.0, 3.0, 4.0]
    assert dut.records["left"].rate == pytest.approx(1.0)
    assert dut.records["right"].stamps == []


def test_a_clock_that_went_back_costs_images_that_are_counted(
    make: Callable[..., LiveRecorder],
) -> None:
    dut = make()
    dut.add("left", image(0, stamp=100.0))
    dut.add("left", image(0, stamp=1.0))  # Before the start, it costs nothing.
    dut.start()
    for stamp in (2.0, 3.0, 2.5, 3.0, 4.0):
        dut.add("left", image(0, stamp=stamp))
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
def test_a_recording_begins_with_labels_if_the_camera_sends_them(
    make: Callable[..., LiveRecorder], labels: dict[int, bool], first: int
) -> None:
    dut = make()
    for k in range(6):
        if k == 1:
            dut.start()
        dut.add("left", image(k, stamp=k * LABEL_WAIT / 2.5, labelled=labels.get(k, False)))
    dut.close()

    assert dut.records["left"].stamps == [k * LABEL_WAIT / 2.5 for k in range(first, 6)]


def test_images_that_a_slow_disk_cannot_take_are_counted(
    make: Callable[..., LiveRecorder], monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on = threading.Event()
    write_messages = DemonstrationWriter.write_messages

    def write_slowly(*args: Any, **stamp: float) -> None:
        go_on.wait()
        write_messages(*args, **stamp)

    monkeypatch.setattr(DemonstrationWriter, "write_messages", write_slowly)
    monkeypatch.setattr(live_recorder, "_WAITING", 4)
    dut = make()
    dut.start()
    for k in range(20):
        dut.add("left", image(k, stamp=float(k)))
    go_on.set()
    dut.close()

    record = dut.records["left"]
    # The thread may have taken one image from the queue of four.
    assert len(record.stamps) in (4, 5)
    assert len(record.stamps) + record.lost == 20
    assert record.stamps == [float(k) for k in range(len(record.stamps))]


def test_after_an_error_images_are_counted_as_lost_and_the_rest_stays_readable(
    make: Callable[..., LiveRecorder], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dut = make()
    dut.start()
    for k in range(120):
        for name in NAMES:
            dut.add(name, image(k, stamp=k / FPS))
    while len(dut.records[NAMES[-1]].stamps) < 120 and dut.error is None:
        time.sleep(0.001)

    def fail(*args: object, **message: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("poil_drake.recording.mcap.sink.Writer.add_message", fail)
    dut.add("left", image(0, stamp=1000.0))
    dut.add("left", image(0, stamp=1001.0))
    dut.close()

    assert isinstance(dut.error, OSError)
    assert dut.records["left"].lost == 2
    with (tmp_path / "demo.mcap").open("rb") as stream:
        assert stream.read()[-8:] != b"\x89MCAP0\r\n"
    assert len(load_demonstration(tmp_path / "demo.mcap").frames) > 80


def test_a_closed_file_is_complete(make: Callable[..., LiveRecorder], tmp_path: Path) -> None:
    dut = make()
    dut.start()
    dut.add("left", image(0, stamp=1.0))
    dut.close()

    with (tmp_path / "demo.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 4  # Calibration, transform, colour and depth.


def test_a_file_that_exists_is_not_touched(
    make: Callable[..., LiveRecorder], tmp_path: Path
) -> None:
    (tmp_path / "demo.mcap").write_text("old")

    with pytest.raises(OutputError, match=r"demo\.mcap' exists already"):
        make().start()

    assert (tmp_path / "demo.mcap").read_text() == "old"


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
def test_gaps_between_stamps_count_as_missing_images(stamps: list[float], count: int) -> None:
    assert CameraRecord(stamps).missing == count
