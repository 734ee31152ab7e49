"""A RealSense, behind a stand-in for its library.

Every name that the stand-in has was checked against pyrealsense2 2.59.1: the frames, the alignment
and the time domain with a software device, the rest by its presence.
"""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from capture_bench import HEIGHT, SIZE, WIDTH, SettableClock

from poil_drake.errors import CaptureError, MissingDependencyError
from poil_drake.perception.capture.config import RealSense
from poil_drake.perception.capture.real_sense import RealSenseDevice

LATENCY = 0.25


class StandIn(ModuleType):
    """The library, with its cameras and with what the pipeline will deliver."""

    def __init__(self) -> None:
        super().__init__("pyrealsense2")
        self.serials = ["123"]
        self.frames: list[object] = []
        self.streams: list[tuple] = []
        self.options: dict[str, float] = {}
        self.stops = 0
        self.start_error: RuntimeError | None = None
        self.stream = SimpleNamespace(color="color", depth="depth")
        self.format = SimpleNamespace(rgb8="rgb8", z16="z16")
        self.option = SimpleNamespace(global_time_enabled="global_time_enabled")
        self.camera_info = SimpleNamespace(serial_number="serial_number")
        self.timestamp_domain = SimpleNamespace(global_time="global_time")
        self.context = lambda: SimpleNamespace(query_devices=lambda: map(_device, self.serials))
        self.config = lambda: SimpleNamespace(
            enable_device=lambda serial: self.streams.append((serial,)),
            enable_stream=lambda *values: self.streams.append(values),
        )
        self.pipeline = lambda context: self
        self.align = lambda stream: SimpleNamespace(process=lambda frames: frames)

    def start(self, config: object) -> SimpleNamespace:
        if self.start_error:
            raise self.start_error
        sensor = SimpleNamespace(
            supports=lambda option: option == "global_time_enabled",
            set_option=self.options.__setitem__,
        )
        device = SimpleNamespace(
            query_sensors=lambda: [sensor],
            first_depth_sensor=lambda: SimpleNamespace(get_depth_scale=lambda: 0.5),
        )
        return SimpleNamespace(get_device=lambda: device)

    def try_wait_for_frames(self, timeout_ms: int) -> tuple[bool, object]:
        frames = self.frames.pop(0) if self.frames else None
        if isinstance(frames, Exception):
            raise frames
        return frames is not None, frames

    def stop(self) -> None:
        self.stops += 1
        raise RuntimeError("stop() cannot be called before start()")


def _device(serial: str) -> SimpleNamespace:
    return SimpleNamespace(get_info=lambda info: serial, supports=lambda info: True)


def frames(*, domain: str = "system_time", size: tuple[int, int] = SIZE) -> SimpleNamespace:
    color = SimpleNamespace(
        get_data=lambda: np.full((*size, 3), 9, np.uint8),
        get_timestamp=lambda: 0.0,
        get_frame_timestamp_domain=lambda: domain,
    )
    depth = SimpleNamespace(get_data=lambda: np.full(size, 3, np.uint16))
    return SimpleNamespace(get_color_frame=lambda: color, get_depth_frame=lambda: depth)


@pytest.fixture
def rs(monkeypatch: pytest.MonkeyPatch) -> StandIn:
    module = StandIn()
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    return module


def make(clock: SettableClock | None = None, **config: object) -> RealSenseDevice:
    return RealSenseDevice(
        RealSense(latency=LATENCY, **config),  # type: ignore[arg-type]
        camera="left",
        size=SIZE,
        clock=clock or SettableClock(),
    )


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)

    with pytest.raises(MissingDependencyError, match="pip install"):
        make()


def test_it_asks_for_the_wanted_camera_size_and_global_time(rs: StandIn) -> None:
    rs.serials = ["7", "123"]

    make(serial="123", fps=15).open()

    assert rs.streams == [
        ("123",),
        ("color", WIDTH, HEIGHT, "rgb8", 15),
        ("depth", WIDTH, HEIGHT, "z16", 15),
    ]
    assert rs.options == {"global_time_enabled": 1.0}


@pytest.mark.parametrize(
    ("serial", "serials"), [("123", []), ("123", ["7"]), ("", []), ("", ["7", "8"])]
)
def test_a_camera_that_is_not_there_is_named_with_those_that_are(
    rs: StandIn, serial: str, serials: list[str]
) -> None:
    rs.serials = serials

    with pytest.raises(CaptureError, match=f"'left'.*{', '.join(serials) or 'none'}"):
        make(serial=serial).open()


def test_a_size_that_it_has_not_is_said(rs: StandIn) -> None:
    rs.start_error = RuntimeError("Couldn't resolve requests")

    with pytest.raises(CaptureError, match=r"8 x 6 pixels.*resolve requests"):
        make().open()


def test_depth_is_in_metres_and_a_stamp_without_global_time_allows_for_latency(rs: StandIn) -> None:
    dut = make(SettableClock(1000.0))
    dut.open()
    rs.frames = [frames()]

    image = dut.read()

    assert image is not None
    np.testing.assert_array_equal(image.depth, np.full(SIZE, 1.5, np.float32))
    np.testing.assert_array_equal(image.rgb, np.full((*SIZE, 3), 9, np.uint8))
    assert image.stamp == 999.75
    assert not image.rgb.flags.writeable
    assert not image.depth.flags.writeable


def test_images_of_another_size_are_refused(rs: StandIn) -> None:
    dut = make()
    dut.open()
    rs.frames = [frames(size=(2, 2))]

    with pytest.raises(CaptureError, match="shape"):
        dut.read()


def test_silence_means_after_a_while_that_it_was_unplugged(rs: StandIn) -> None:
    clock = SettableClock(1000.0)
    dut = make(clock, silence=2.0)
    dut.open()
    clock.now = 1001.0
    assert dut.read() is None
    rs.serials, clock.now = [], 1003.0

    with pytest.raises(CaptureError, match="no image for 2 s; connected are: none"):
        dut.read()


def test_an_error_of_the_library_is_a_capture_error(rs: StandIn) -> None:
    dut = make()
    dut.open()
    rs.frames = [RuntimeError("Device disconnected")]

    with pytest.raises(CaptureError, match="Device disconnected"):
        dut.read()


def test_it_closes_once_and_without_complaint(rs: StandIn) -> None:
    dut = make()
    dut.close()
    dut.open()
    dut.close()
    dut.close()

    assert rs.stops == 1
    with pytest.raises(CaptureError, match="not open"):
        dut.read()
