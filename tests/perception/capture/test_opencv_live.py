"""Live sources of OpenCV, with a stand-in for its `VideoCapture`."""

import threading
from collections import deque
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from capture_bench import CAMERA, HEIGHT, SIZE, TIMEOUT, WIDTH, SettableClock

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.config import OpenCvStreams
from poil_drake.perception.capture.opencv_streams import OpenCvStreamsDevice
from poil_drake.perception.images import RgbdImage

MJPG = cv2.VideoWriter.fourcc(*"MJPG")


class Capture:
    """A device with a queue; `grab` waits for an image and takes the oldest."""

    def __init__(self) -> None:
        self.properties: dict[int, float] = {}
        self.stubborn: dict[int, float] = {}
        self.released = threading.Event()
        self._queue: deque[np.ndarray | None] = deque()
        self._changed = threading.Condition()
        self._image: np.ndarray | None = None
        self._waiting = False

    def send(self, *images: np.ndarray | None) -> None:
        """Queues images, None for the end; returns when all are fetched and `grab` waits again."""
        with self._changed:
            self._queue.extend(images)
            self._changed.notify_all()
            done = self._changed.wait_for(
                lambda: self.released.is_set() or (self._waiting and not self._queue), TIMEOUT
            )
        assert done

    def isOpened(self) -> bool:
        return True

    def set(self, key: int, value: float) -> bool:
        self.properties[key] = value
        return True

    def get(self, key: int) -> float:
        return self.stubborn.get(key, self.properties.get(key, 0.0))

    def grab(self) -> bool:
        with self._changed:
            self._waiting = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._queue, TIMEOUT)
            self._waiting = False
            self._image = self._queue.popleft() if self._queue else None
        return self._image is not None

    def retrieve(self) -> tuple[bool, np.ndarray | None]:
        return True, self._image

    def release(self) -> None:
        self.released.set()
        with self._changed:
            self._changed.notify_all()


class Bench:
    """A camera whose colour is device 0 and whose depth is device 1."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.rgb, self.depth = Capture(), Capture()
        self.clock = SettableClock(1000.0)
        monkeypatch.setattr(cv2, "VideoCapture", lambda number: (self.rgb, self.depth)[number])

    def open(self, **config: object) -> OpenCvStreamsDevice:
        given = {"rgb": "0", "depth": "1", "settle": 0.0, "latency": 0.25, **config}
        self.dut = OpenCvStreamsDevice(
            OpenCvStreams(**given),  # type: ignore[arg-type]
            camera=CAMERA,
            clock=self.clock,
        )
        self.dut.open()
        return self.dut

    def send(self, *, rgb: int | None = None, depth: int | None = None, at: float) -> None:
        """Sends images of one value at some time [s]."""
        self.clock.now = at
        if rgb is not None:
            self.rgb.send(np.full((*SIZE, 3), rgb, np.uint8))
        if depth is not None:
            self.depth.send(np.full(SIZE, depth, np.uint16))


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    bench = Bench(monkeypatch)
    yield bench
    for capture in (bench.rgb, bench.depth):
        if not capture.released.is_set():
            capture.send(None)
    bench.dut.close()


def values(image: RgbdImage | None) -> tuple[int, float, float] | None:
    """Returns the colour, depth and stamp of an image."""
    return image and (int(image.rgb[0, 0, 0]), round(float(image.depth[0, 0]), 6), image.stamp)


def test_only_the_newest_images_are_read(bench: Bench) -> None:
    dut = bench.open()
    for k in range(1, 4):
        bench.send(rgb=k, depth=1000 * k, at=1000.0 + k)

    assert values(dut.read()) == (3, 3.0, 1002.75)
    assert dut.read() is None


@pytest.mark.parametrize(
    ("later", "expected"), [(1000.015625, (1, 1.0, 999.75)), (1000.03125, None)]
)
def test_a_pair_has_the_stamp_of_its_older_arrival_unless_the_gap_is_too_large(
    bench: Bench, later: float, expected: tuple[int, float, float] | None
) -> None:
    dut = bench.open(largest_gap=0.02)
    bench.send(depth=1000, at=1000.0)
    bench.send(rgb=1, at=later)

    assert values(dut.read()) == expected


def test_depth_at_half_the_rate_of_colour_does_not_fall_behind(bench: Bench) -> None:
    dut = bench.open()
    stamps = []
    for k in range(8):
        bench.send(rgb=k, at=1000.0 + k / 32)
        if k % 2:
            bench.send(depth=1000, at=bench.clock.now + 1 / 128)
        image = dut.read()
        if image is not None:
            stamps.append(image.stamp + 0.25 - 1000.0)

    assert stamps == [1 / 32, 3 / 32, 5 / 32, 7 / 32]


def test_images_are_dropped_while_the_exposure_adapts(bench: Bench) -> None:
    dut = bench.open(settle=1.0)
    bench.send(rgb=1, depth=1000, at=1000.5)
    assert dut.read() is None
    bench.send(rgb=2, depth=2000, at=1001.0)

    assert values(dut.read()) == (2, 2.0, 1000.75)


def test_a_silent_source_is_reported(bench: Bench) -> None:
    dut = bench.open(silence=2.0)
    bench.send(rgb=1, depth=1000, at=1000.0)
    assert dut.read() is not None
    bench.send(rgb=2, at=1002.5)

    with pytest.raises(CaptureError, match=r"no new pair for 2 s.*'0': 0\.00 s ago, '1': 2\.50 s"):
        dut.read()


def test_a_source_that_ends_is_reported(bench: Bench) -> None:
    dut = bench.open()
    bench.depth.send(None)

    with pytest.raises(CaptureError, match="ended; last images: '0': none"):
        dut.read()


def test_the_scenarios_size_and_the_format_are_requested_of_a_device(bench: Bench) -> None:
    bench.open(fps=15.0, rgb_fourcc="MJPG")

    assert bench.rgb.properties == {
        cv2.CAP_PROP_FOURCC: MJPG,
        cv2.CAP_PROP_FRAME_WIDTH: WIDTH,
        cv2.CAP_PROP_FRAME_HEIGHT: HEIGHT,
        cv2.CAP_PROP_FPS: 15.0,
    }
    assert cv2.CAP_PROP_FOURCC not in bench.depth.properties
    assert bench.depth.properties[cv2.CAP_PROP_CONVERT_RGB] == 0


@pytest.mark.parametrize(
    ("stubborn", "said"),
    [
        ({cv2.CAP_PROP_FRAME_WIDTH: 640}, "'0' delivers 640 x 6 pixels as 'MJPG', not 8 x 6"),
        ({cv2.CAP_PROP_FOURCC: cv2.VideoWriter.fourcc(*"YUYV")}, "8 x 6 pixels as 'YUYV'"),
    ],
)
def test_a_device_with_another_size_or_format_is_rejected(
    bench: Bench, stubborn: dict[int, float], said: str
) -> None:
    bench.rgb.stubborn = stubborn

    with pytest.raises(CaptureError, match=said):
        bench.open(rgb_fourcc="MJPG")

    assert bench.rgb.released.is_set()
    bench.depth.release()


def test_close_releases_both_devices(bench: Bench) -> None:
    dut = bench.open()
    bench.rgb.send(None)
    bench.depth.send(None)

    dut.close()
    dut.close()

    assert bench.rgb.released.is_set()
    assert bench.depth.released.is_set()
