from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from capture_bench import SettableClock

from poil_drake.errors import CaptureError, InvalidValueError, NoImageError, NoMoreImagesError
from poil_drake.perception.capture.config import McapPlayback
from poil_drake.perception.images import CameraModel
from poil_drake.recording.demonstration.camera_playback import CameraPlayback
from poil_drake.recording.mcap.message_encoder import ColorEncoding
from poil_drake.recording.run_log.writer import RunLogConfig, RunLogWriter

SIZE = (24, 32)
K = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
CAMERA = CameraModel("left", 32, 24, K, DOWN)
COUNT, PERIOD = 4, 0.125


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Four images of one camera; the k-th has colour and depth k + 1."""
    return write_log(tmp_path_factory.mktemp("log"), labelled=())


def write_log(folder: Path, *, labelled: Sequence[int]) -> str:
    """Writes the images, and for some of them a label image that is k + 1 everywhere."""
    path = folder / "run.mcap"
    config = RunLogConfig(color=ColorEncoding(format="raw"))
    with RunLogWriter(path, config=config) as writer:
        writer.write_calibration(CAMERA, time=10.0)
        for k in range(COUNT):
            time = 10.0 + k * PERIOD
            writer.write_image("left", np.full((*SIZE, 3), k + 1, np.uint8), time=time)
            writer.write_depth("left", np.full(SIZE, float(k + 1)), time=time)
            if k in labelled:
                writer.write_label("left", np.full(SIZE, k + 1, np.int16), time=time)
    return str(path)


def play(
    file: str, *, steps: int, step: float, every_image: bool = False, **config: object
) -> list[tuple[int, float]]:
    """Reads every `step` [s], and returns the images and their stamps since the start."""
    clock = SettableClock(1000.0)
    dut = CameraPlayback(
        McapPlayback(file=file, lead_in=1.0, labels=False, **config),  # type: ignore[arg-type]
        camera=CAMERA,
        clock=clock,
        every_image=every_image,
    )
    dut.open()
    clock.now = 1001.0
    found = []
    for _ in range(steps):
        image = None
        with suppress(NoImageError):
            image = dut.read()
        if image is not None:
            assert image.depth[0, 0] == image.rgb[0, 0, 0]
            found.append((int(image.rgb[0, 0, 0]), image.stamp - 1001.0))
        clock.now += step
    dut.close()
    dut.close()
    return found


@pytest.mark.parametrize(
    ("steps", "step", "config", "expected"),
    [
        (8, PERIOD, {}, [(1, 0.0), (2, 0.125), (3, 0.25), (4, 0.375)]),
        (6, PERIOD, {"loop": True}, [(k % 4 + 1, k * PERIOD) for k in range(6)]),
        (4, PERIOD / 2, {"rate": 2.0}, [(k + 1, k * PERIOD / 2) for k in range(4)]),
        (2, 2 * PERIOD, {}, [(1, 0.0), (3, 0.25)]),
        (3, 2 * PERIOD, {"every_image": True}, [(1, 0.0), (2, 0.125), (3, 0.25)]),
    ],
    ids=["once", "in a loop", "twice as fast", "without late images", "with late images"],
)
def test_it_plays_in_real_time(
    log: str, steps: int, step: float, config: dict, expected: list[tuple[int, float]]
) -> None:
    assert play(log, steps=steps, step=step, **config) == expected


def test_the_end_of_the_file_is_reported(log: str, clock: SettableClock) -> None:
    dut = CameraPlayback(McapPlayback(file=log, labels=False), camera=CAMERA, clock=clock)
    dut.open()
    clock.now = 1010.0
    assert dut.read() is not None

    with pytest.raises(NoMoreImagesError, match=r"'left'.*run\.mcap has ended"):
        dut.read()


def test_recorded_labels_are_delivered(tmp_path: Path, clock: SettableClock) -> None:
    log = write_log(tmp_path, labelled=(0,))
    dut = CameraPlayback(McapPlayback(file=log, labels=True), camera=CAMERA, clock=clock)
    dut.open()

    labels = []
    for k in range(2):
        clock.now = 1001.0 + k * PERIOD
        image = dut.read()
        assert image is not None
        labels.append(image.label)

    np.testing.assert_array_equal(labels[0], np.ones(SIZE, np.int16))
    assert labels[1] is None


@pytest.mark.parametrize(
    ("config", "camera", "problem"),
    [
        ({"camera": "top"}, CAMERA, "'top'"),
        ({"file": "none.mcap"}, CAMERA, "none.mcap"),
        ({}, CameraModel("left", 4, 4, K, np.eye(4)), "32 x 24"),
        ({}, CameraModel("left", 32, 24, K + 1.5 * np.eye(3), np.eye(4)), "30.00, 30.00, 15.50"),
        ({"labels": True}, CAMERA, "no label images"),
    ],
)
def test_an_unusable_file_is_reported(
    log: str, config: dict, camera: CameraModel, problem: str
) -> None:
    given = McapPlayback(**{"file": log, "labels": False, **config})
    dut = CameraPlayback(given, camera=camera, clock=SettableClock())

    with pytest.raises(CaptureError, match=problem):
        dut.open()


def test_a_file_is_required() -> None:
    with pytest.raises(InvalidValueError, match=r"McapPlayback\.file"):
        CameraPlayback(McapPlayback(), camera=CAMERA, clock=SettableClock())
