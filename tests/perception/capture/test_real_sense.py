"""A RealSense, behind a stand-in for its library.

Every name that the stand-in has was checked against pyrealsense2 2.59.1: the frames, the alignment
and the time domain with a software device, the projection by calls, the rest by its presence.
"""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from capture_bench import CAMERA, HEIGHT, SIZE, WIDTH, K, SettableClock

from poil_drake.errors import CaptureError, MissingDependencyError, NoImageError
from poil_drake.perception.capture.config import RealSense
from poil_drake.perception.capture.real_sense.device import RealSenseDevice
from poil_drake.perception.images import CameraModel

LATENCY = 0.25
NO_DISTORTION = (0.0, 0.0, 0.0, 0.0, 0.0)


class StandIn(ModuleType):
    """The library, with its cameras and with what the pipeline will deliver."""

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
            coeffs=NO_DISTORTION,
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

    def rs2_project_point_to_pixel(self, intrinsics: SimpleNamespace, point: list) -> list[float]:
        """Brown-Conrady, as the library has it for `brown_conrady`."""
        x, y = point[0] / point[2], point[1] / point[2]
        k1, k2, p1, p2, k3 = intrinsics.coeffs
        r2 = x * x + y * y
        f = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        u = x * f + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        v = y * f + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y)
        return [u * intrinsics.fx + intrinsics.ppx, v * intrinsics.fy + intrinsics.ppy]

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
    raw: np.ndarray | None = None,
) -> SimpleNamespace:
    """A pair of frames, by the numbers and stamps [s] of colour and depth."""
    raw = np.full(size, 3, np.uint16) if raw is None else raw
    color = frame(np.full((*size, 3), 9, np.uint8), numbers[0], stamps[0], domain)
    depth = frame(raw, numbers[1], stamps[1], domain)
    return SimpleNamespace(get_color_frame=lambda: color, get_depth_frame=lambda: depth)


@pytest.fixture
def rs(monkeypatch: pytest.MonkeyPatch) -> StandIn:
    module = StandIn()
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    return module


@pytest.fixture
def clock() -> SettableClock:
    """Our clock, which is the computer's, too."""
    return SettableClock(1000.0)


def make(
    clock: SettableClock | None = None, *, camera: CameraModel = CAMERA, **config: object
) -> RealSenseDevice:
    given = RealSense(**{"latency": LATENCY, "settle": 0.0, **config})  # type: ignore[arg-type]
    clock = clock or SettableClock()
    return RealSenseDevice(given, camera=camera, clock=clock, host_clock=clock)


def opened(rs: StandIn, clock: SettableClock, **config: object) -> RealSenseDevice:
    dut = make(clock, **config)
    dut.open()
    return dut


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


def test_depth_is_in_metres_and_invalid_where_it_is_0_or_too_far(
    rs: StandIn, clock: SettableClock
) -> None:
    dut = opened(rs, clock)
    raw = np.full(SIZE, 3, np.uint16)
    raw[0, :2] = 0, 65535
    expected = np.full(SIZE, 1.5, np.float32)
    expected[0, :2] = 0.0
    rs.frames = [frames(raw=raw)]

    image = dut.read()

    assert image is not None
    np.testing.assert_array_equal(image.depth, expected)
    np.testing.assert_array_equal(image.rgb, np.full((*SIZE, 3), 9, np.uint8))
    assert not image.rgb.flags.writeable
    assert not image.depth.flags.writeable


def test_with_global_time_the_stamp_is_that_of_the_older_frame(
    rs: StandIn, clock: SettableClock
) -> None:
    dut = opened(rs, clock)
    rs.frames = [
        frames(numbers=(1, 1), stamps=(999.875, 999.8828125)),
        frames(numbers=(2, 2), stamps=(999.9140625, 999.90625)),
    ]

    assert [image and image.stamp for image in (dut.read(), dut.read())] == [999.875, 999.90625]


def test_with_arrival_times_the_latency_is_taken_off(rs: StandIn, clock: SettableClock) -> None:
    dut = opened(rs, clock)
    rs.frames = [frames(stamps=(999.5, 999.5), domain="system_time")]

    image = dut.read()

    assert image is not None
    assert image.stamp == 999.25


def test_with_the_cameras_clock_the_fastest_frame_tells_its_offset(
    rs: StandIn, clock: SettableClock
) -> None:
    dut = opened(rs, clock)
    stamps = []
    # The second is fetched 0.5 s late, as after a halt of this program.
    for number, (time_, now) in enumerate([(5.0, 1000.0), (5.25, 1000.75), (5.5, 1000.5)], 1):
        clock.now = now
        rs.frames = [frames(numbers=(number,) * 2, stamps=(time_, time_), domain="hardware_clock")]
        image = dut.read()
        assert image is not None
        stamps.append(image.stamp)

    assert stamps == [1000.0 - LATENCY, 1000.25 - LATENCY, 1000.5 - LATENCY]


def test_a_clock_of_the_camera_that_begins_again_is_followed(
    rs: StandIn, clock: SettableClock
) -> None:
    dut = opened(rs, clock)
    rs.frames = [
        frames(numbers=(1, 1), stamps=(4294.0, 4294.0), domain="hardware_clock"),
        frames(numbers=(2, 2), stamps=(0.5, 0.5), domain="hardware_clock"),
    ]
    assert dut.read() is not None
    clock.now = 1000.25

    image = dut.read()

    assert image is not None
    assert image.stamp == 1000.25 - LATENCY


@pytest.mark.parametrize("domain", ["global_time", "system_time", "hardware_clock"])
@pytest.mark.parametrize("numbers", [(2, 1), (1, 2), (1, 1)])
def test_a_frame_that_is_repeated_is_not_new(
    rs: StandIn, clock: SettableClock, domain: str, numbers: tuple[int, int]
) -> None:
    dut = opened(rs, clock)
    rs.frames = [frames(domain=domain), frames(numbers=numbers, domain=domain)]
    assert dut.read() is not None
    clock.now += 0.125

    assert dut.read() is None


def test_frames_that_come_one_after_the_other_make_a_pair(
    rs: StandIn, clock: SettableClock
) -> None:
    dut = opened(rs, clock)
    rs.frames = [
        frames(numbers=(1, 1), stamps=(999.75, 999.75)),
        frames(numbers=(2, 1), stamps=(999.765625, 999.75)),
        frames(numbers=(2, 2), stamps=(999.765625, 999.765625)),
    ]

    stamps = [image and image.stamp for image in (dut.read(), dut.read(), dut.read())]

    assert stamps == [999.75, None, 999.765625]


def test_frames_of_different_instants_are_no_pair(rs: StandIn, clock: SettableClock) -> None:
    dut = opened(rs, clock, fps=30)
    rs.frames = [frames(stamps=(999.975, 999.95))]

    assert dut.read() is None


def test_a_frozen_depth_stream_is_named_after_a_while(rs: StandIn, clock: SettableClock) -> None:
    dut = opened(rs, clock, silence=0.5)
    for number in range(1, 5):
        clock.now = 1000.0 + 0.125 * number
        rs.frames.append(frames(numbers=(number, 1), stamps=(clock.now, 1000.125)))
        assert (dut.read() is None) == (number > 1)
    clock.now = 1000.75
    rs.frames.append(frames(numbers=(5, 1), stamps=(1000.75, 1000.125)))

    with pytest.raises(CaptureError, match=r"no new image for 0\.5 s"):
        dut.read()


def test_images_are_dropped_while_the_exposure_adjusts_itself(
    rs: StandIn, clock: SettableClock
) -> None:
    dut = opened(rs, clock, settle=1.0)
    rs.frames = [frames(numbers=(1, 1)), frames(numbers=(2, 2), stamps=(1001.0, 1001.0))]
    clock.now = 1000.5
    assert dut.read() is None
    assert rs.aligned == 0
    clock.now = 1001.0

    assert dut.read() is not None


def test_other_intrinsics_than_the_scenarios_are_refused(rs: StandIn) -> None:
    rs.intrinsics.fx += 2.0

    with pytest.raises(CaptureError, match=r"22\.00, 20\.00, 3\.50, 2\.50 px, but the scenario"):
        make().open()


def test_images_of_another_size_are_refused(rs: StandIn, clock: SettableClock) -> None:
    dut = opened(rs, clock)
    rs.frames = [frames(size=(2, 2))]

    with pytest.raises(NoImageError, match="shape"):
        dut.read()


def test_silence_means_after_a_while_that_it_was_unplugged(rs: StandIn) -> None:
    clock = SettableClock(1000.0)
    dut = make(clock, silence=2.0)
    dut.open()
    clock.now = 1001.0
    assert dut.read() is None
    rs.serials, clock.now = [], 1003.0

    with pytest.raises(CaptureError, match="no new image for 2 s; connected are: none"):
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
