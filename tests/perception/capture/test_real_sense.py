"""A RealSense, with a stand-in for its library.

All names of the stand-in were checked against pyrealsense2 2.59.1: frames, alignment and time
domain with a software device, the others by their presence.
"""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from capture_bench import CAMERA, HEIGHT, SIZE, WIDTH, K, SettableClock

from poil_drake.errors import CaptureError, NoImageError
from poil_drake.perception.capture.config import RealSense
from poil_drake.perception.capture.real_sense import RealSenseDevice

LATENCY = 0.25


class StandIn(ModuleType):
    """The library, its cameras, and the frames that the pipeline will deliver."""

    def __init__(self) -> None:
        super().__init__("pyrealsense2")
        self.serials = ["123"]
        self.frames: list[object] = []
        self.aligned = 0
        self.streams: list[tuple] = []
        self.options: dict[str, float] = {}
        self.stops = 0
        self.start_error: RuntimeError | None = None
        self.intrinsics = SimpleNamespace(
            width=WIDTH,
            height=HEIGHT,
            fx=K[0, 0],
            fy=K[1, 1],
            ppx=K[0, 2],
            ppy=K[1, 2],
            model=SimpleNamespace(name="inverse_brown_conrady"),
            coeffs=[0.0] * 5,
        )
        self.stream = SimpleNamespace(color="color", depth="depth")
        self.format = SimpleNamespace(rgb8="rgb8", z16="z16")
        self.option = SimpleNamespace(global_time_enabled="global_time_enabled")
        self.camera_info = SimpleNamespace(serial_number="serial_number")
        self.timestamp_domain = SimpleNamespace(
            global_time="global_time", system_time="system_time", hardware_clock="hardware_clock"
        )
        self.context = lambda: SimpleNamespace(query_devices=lambda: map(_device, self.serials))
        self.config = lambda: SimpleNamespace(
            enable_device=lambda serial: self.streams.append((serial,)),
            enable_stream=lambda *values: self.streams.append(values),
        )
        self.pipeline = lambda context: self
        self.align = lambda stream: SimpleNamespace(process=self._align)

    def _align(self, frames: object) -> object:
        self.aligned += 1
        return frames

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
        video = SimpleNamespace(get_intrinsics=lambda: self.intrinsics)
        stream = SimpleNamespace(as_video_stream_profile=lambda: video)
        return SimpleNamespace(get_device=lambda: device, get_stream=lambda kind: stream)

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


def frame(pixels: np.ndarray, number: int, stamp: float, domain: str) -> SimpleNamespace:
    return SimpleNamespace(
        get_data=lambda: pixels,
        get_frame_number=lambda: number,
        get_timestamp=lambda: 1e3 * stamp,
        get_frame_timestamp_domain=lambda: domain,
    )


def frames(
    *,
    numbers: tuple[int, int] = (1, 1),
    stamps: tuple[float, float] = (1000.0, 1000.0),
    domain: str = "global_time",
    size: tuple[int, int] = SIZE,
) -> SimpleNamespace:
    """Returns a pair of frames with the numbers and stamps [s] of colour and depth."""
    color = frame(np.full((*size, 3), 9, np.uint8), numbers[0], stamps[0], domain)
    depth = frame(np.full(size, 3, np.uint16), numbers[1], stamps[1], domain)
    return SimpleNamespace(get_color_frame=lambda: color, get_depth_frame=lambda: depth)


@pytest.fixture
def rs(monkeypatch: pytest.MonkeyPatch) -> StandIn:
    module = StandIn()
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    return module


def make(clock: SettableClock, **config: object) -> RealSenseDevice:
    given = RealSense(**{"latency": LATENCY, "settle": 0.0, **config})  # type: ignore[arg-type]
    return RealSenseDevice(given, camera=CAMERA, clock=clock)


def opened(clock: SettableClock, **config: object) -> RealSenseDevice:
    dut = make(clock, **config)
    dut.open()
    return dut


@pytest.fixture
def dut(rs: StandIn, clock: SettableClock) -> RealSenseDevice:
    """An open camera."""
    return opened(clock)


def stamps_of(dut: RealSenseDevice, count: int) -> list[float | None]:
    """Reads `count` times and returns the stamps of the images, None where there was none."""
    return [image and image.stamp for image in (dut.read() for _ in range(count))]


def test_it_requests_the_camera_the_size_and_global_time(rs: StandIn, clock: SettableClock) -> None:
    rs.serials = ["7", "123"]

    opened(clock, serial="123", fps=15)

    assert rs.streams == [
        ("123",),
        ("color", WIDTH, HEIGHT, "rgb8", 15),
        ("depth", WIDTH, HEIGHT, "z16", 15),
    ]
    assert rs.options == {"global_time_enabled": 1.0}


@pytest.mark.parametrize(
    ("serial", "serials"), [("123", []), ("123", ["7"]), ("", []), ("", ["7", "8"])]
)
def test_an_error_names_the_camera_that_is_missing_and_those_that_are_connected(
    rs: StandIn, clock: SettableClock, serial: str, serials: list[str]
) -> None:
    rs.serials = serials

    with pytest.raises(CaptureError, match=f"'left'.*{', '.join(serials) or 'none'}"):
        opened(clock, serial=serial)


def test_an_error_names_a_size_that_the_camera_lacks(rs: StandIn, clock: SettableClock) -> None:
    rs.start_error = RuntimeError("Couldn't resolve requests")

    with pytest.raises(CaptureError, match=r"8 x 6 pixels.*resolve requests"):
        opened(clock)


def test_images_are_read_only_and_depth_is_in_metres(rs: StandIn, dut: RealSenseDevice) -> None:
    rs.frames = [frames()]

    image = dut.read()

    assert image is not None
    np.testing.assert_array_equal(image.depth, np.full(SIZE, 1.5, np.float32))
    np.testing.assert_array_equal(image.rgb, np.full((*SIZE, 3), 9, np.uint8))
    assert not image.rgb.flags.writeable
    assert not image.depth.flags.writeable


@pytest.mark.parametrize(
    ("pairs", "expected"),
    [
        ([frames(stamps=(999.875, 999.8828125))], [999.875]),
        ([frames(stamps=(999.9140625, 999.90625))], [999.90625]),
        ([frames(stamps=(999.5, 999.5), domain="system_time")], [999.5 - LATENCY]),
        ([frames(stamps=(999.975, 999.95))], [None]),
        (
            [
                frames(numbers=(1, 1), stamps=(999.75, 999.75)),
                frames(numbers=(2, 1), stamps=(999.765625, 999.75)),
                frames(numbers=(2, 2), stamps=(999.765625, 999.765625)),
            ],
            [999.75, None, 999.765625],
        ),
    ],
    ids=["older colour", "older depth", "arrival times", "other instants", "one after the other"],
)
def test_a_pair_has_the_stamp_of_its_older_frame(
    rs: StandIn, dut: RealSenseDevice, pairs: list[object], expected: list[float | None]
) -> None:
    rs.frames = pairs.copy()

    assert stamps_of(dut, len(pairs)) == expected


def test_with_the_cameras_clock_the_fastest_frame_determines_its_offset(
    rs: StandIn, dut: RealSenseDevice, clock: SettableClock
) -> None:
    stamps = []
    # The second is fetched 0.5 s late, as after a halt of this program.
    for number, (time_, now) in enumerate([(5.0, 1000.0), (5.25, 1000.75), (5.5, 1000.5)], 1):
        clock.now = now
        rs.frames = [frames(numbers=(number,) * 2, stamps=(time_, time_), domain="hardware_clock")]
        stamps += stamps_of(dut, 1)

    assert stamps == [1000.0 - LATENCY, 1000.25 - LATENCY, 1000.5 - LATENCY]


def test_a_camera_clock_that_restarts_gets_a_new_offset(
    rs: StandIn, dut: RealSenseDevice, clock: SettableClock
) -> None:
    rs.frames = [
        frames(numbers=(1, 1), stamps=(4294.0, 4294.0), domain="hardware_clock"),
        frames(numbers=(2, 2), stamps=(0.5, 0.5), domain="hardware_clock"),
    ]
    assert dut.read() is not None
    clock.now = 1000.25

    assert stamps_of(dut, 1) == [1000.25 - LATENCY]


@pytest.mark.parametrize("domain", ["global_time", "system_time", "hardware_clock"])
@pytest.mark.parametrize("numbers", [(2, 1), (1, 2), (1, 1)])
def test_a_repeated_frame_is_not_new(
    rs: StandIn, dut: RealSenseDevice, clock: SettableClock, domain: str, numbers: tuple[int, int]
) -> None:
    rs.frames = [frames(domain=domain), frames(numbers=numbers, domain=domain)]
    assert dut.read() is not None
    clock.now += 0.125

    assert dut.read() is None


def test_a_frozen_depth_stream_is_reported(rs: StandIn, clock: SettableClock) -> None:
    dut = opened(clock, silence=0.5)
    for number in range(1, 5):
        clock.now = 1000.0 + 0.125 * number
        rs.frames.append(frames(numbers=(number, 1), stamps=(clock.now, 1000.125)))
        assert (dut.read() is None) == (number > 1)
    clock.now = 1000.75
    rs.frames.append(frames(numbers=(5, 1), stamps=(1000.75, 1000.125)))

    with pytest.raises(CaptureError, match=r"no new image for 0\.5 s"):
        dut.read()


def test_images_are_dropped_while_the_exposure_adapts(rs: StandIn, clock: SettableClock) -> None:
    dut = opened(clock, settle=1.0)
    rs.frames = [frames(numbers=(1, 1)), frames(numbers=(2, 2), stamps=(1001.0, 1001.0))]
    clock.now = 1000.5
    assert dut.read() is None
    assert rs.aligned == 0
    clock.now = 1001.0

    assert dut.read() is not None


def test_intrinsics_other_than_the_scenarios_are_rejected(
    rs: StandIn, clock: SettableClock
) -> None:
    rs.intrinsics.fx += 2.0

    with pytest.raises(CaptureError, match=r"22\.00, 20\.00, 3\.50, 2\.50 px, but the scenario"):
        opened(clock)


def test_silence_is_reported_with_the_connected_cameras(rs: StandIn, clock: SettableClock) -> None:
    dut = opened(clock, silence=2.0)
    clock.now = 1001.0
    assert dut.read() is None
    rs.serials, clock.now = [], 1003.0

    with pytest.raises(CaptureError, match="no new image for 2 s; connected cameras: none"):
        dut.read()


@pytest.mark.parametrize(
    ("delivered", "error", "problem"),
    [
        (frames(size=(2, 2)), NoImageError, "shape"),
        (RuntimeError("Device disconnected"), CaptureError, "Device disconnected"),
    ],
)
def test_unusable_frames_and_errors_of_the_library_are_reported(
    rs: StandIn, dut: RealSenseDevice, delivered: object, error: type[CaptureError], problem: str
) -> None:
    rs.frames = [delivered]

    with pytest.raises(error, match=problem):
        dut.read()


def test_it_closes_once_and_raises_nothing(rs: StandIn, clock: SettableClock) -> None:
    dut = make(clock)
    dut.close()
    dut.open()
    dut.close()
    dut.close()

    assert rs.stops == 1
