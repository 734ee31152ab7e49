"""A ZED, behind a stand-in for its SDK. The SDK's names are from its documentation, unchecked."""

import sys
import time
from enum import Enum
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from capture_bench import SIZE

from poil_drake.errors import CaptureError, InvalidValueError, MissingDependencyError
from poil_drake.perception.capture.config import Zed
from poil_drake.perception.capture.zed import ZedDevice

ERROR_CODE = Enum("ERROR_CODE", "SUCCESS CAMERA_NOT_DETECTED CAMERA_REBOOTING CAMERA_DETECTED")
RESOLUTION = Enum("RESOLUTION", "HD720 VGA LAST")
DEPTH_MODE = Enum("DEPTH_MODE", "NEURAL PERFORMANCE LAST")


class Mat:
    data = np.zeros(0)

    def get_data(self) -> np.ndarray:
        return self.data


class StandIn(ModuleType):
    """The SDK, with a camera of twice the wanted size."""

    def __init__(self) -> None:
        super().__init__("pyzed.sl")
        self.ERROR_CODE, self.RESOLUTION, self.DEPTH_MODE = ERROR_CODE, RESOLUTION, DEPTH_MODE
        self.UNIT = SimpleNamespace(METER="metre")
        self.VIEW, self.MEASURE = SimpleNamespace(LEFT="left"), SimpleNamespace(DEPTH="depth")
        self.MEM, self.TIME_REFERENCE = SimpleNamespace(CPU="cpu"), SimpleNamespace(IMAGE="image")
        self.Mat, self.RuntimeParameters = Mat, SimpleNamespace
        self.Resolution = lambda width, height: SimpleNamespace(width=width, height=height)
        self.InitParameters = lambda: SimpleNamespace(set_from_serial_number=self.serials.append)
        self.serials: list[int] = []
        self.opened, self.grabbed, self.closes = ERROR_CODE.SUCCESS, ERROR_CODE.SUCCESS, 0
        self.native = SimpleNamespace(width=2 * SIZE[1], height=2 * SIZE[0])
        self.depth = np.full(SIZE, 2.0, np.float32)
        self.depth[0, :3] = np.nan, np.inf, -np.inf
        self.stamp_ns = time.time_ns()
        camera = type(
            "Camera",
            (),
            {"__new__": lambda cls: self, "get_device_list": staticmethod(self._devices)},
        )
        self.Camera = camera

    def _devices(self) -> list[SimpleNamespace]:
        return [SimpleNamespace(serial_number=77)]

    def open(self, parameters: SimpleNamespace) -> ERROR_CODE:
        self.parameters = parameters
        return self.opened

    def get_camera_information(self) -> SimpleNamespace:
        return SimpleNamespace(camera_configuration=SimpleNamespace(resolution=self.native))

    def grab(self, runtime: object) -> ERROR_CODE:
        return self.grabbed

    def get_timestamp(self, reference: str) -> SimpleNamespace:
        return SimpleNamespace(get_nanoseconds=lambda: self.stamp_ns)

    def retrieve_image(self, mat: Mat, view: str, memory: str, size: object) -> ERROR_CODE:
        mat.data = np.full((*SIZE, 4), (1, 2, 3, 255), np.uint8)
        return ERROR_CODE.SUCCESS

    def retrieve_measure(self, mat: Mat, measure: str, memory: str, size: object) -> ERROR_CODE:
        mat.data = self.depth
        return ERROR_CODE.SUCCESS

    def close(self) -> None:
        self.closes += 1


@pytest.fixture
def sl(monkeypatch: pytest.MonkeyPatch) -> StandIn:
    module = StandIn()
    package = ModuleType("pyzed")
    package.sl = module  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pyzed", package)
    monkeypatch.setitem(sys.modules, "pyzed.sl", module)
    return module


def make(**config: object) -> ZedDevice:
    config = {"latency": 0.0, **config}
    return ZedDevice(Zed(**config), camera="left", size=SIZE, clock=time.time)  # type: ignore[arg-type]


def test_without_the_sdk_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyzed", None)

    with pytest.raises(MissingDependencyError, match="ZED SDK"):
        make()


def test_it_asks_for_metres_and_for_the_wanted_camera(sl: StandIn) -> None:
    make(serial=77, fps=15).open()

    assert sl.serials == [77]
    assert sl.parameters.coordinate_units == "metre"
    assert sl.parameters.camera_resolution is RESOLUTION.HD720
    assert sl.parameters.depth_mode is DEPTH_MODE.NEURAL
    assert sl.parameters.camera_fps == 15


@pytest.mark.parametrize("field", ["resolution", "depth_mode"])
def test_a_name_that_the_sdk_does_not_know_is_refused(sl: StandIn, field: str) -> None:
    with pytest.raises(InvalidValueError, match=field):
        make(**{field: "SHARP"})


def test_a_camera_that_does_not_open_is_named_with_those_that_are_there(sl: StandIn) -> None:
    sl.opened = ERROR_CODE.CAMERA_NOT_DETECTED

    with pytest.raises(CaptureError, match=r"'left' \(ZED 5\).*CAMERA_NOT_DETECTED.*77"):
        make(serial=5).open()


def test_an_image_is_rgb_with_depth_0_where_nothing_was_measured(sl: StandIn) -> None:
    dut = make()
    dut.open()
    expected = np.full(SIZE, 2.0, np.float32)
    expected[0, :3] = 0.0

    image = dut.read()

    assert image is not None
    np.testing.assert_array_equal(image.rgb[2, 3], (3, 2, 1))
    np.testing.assert_array_equal(image.depth, expected)
    assert image.stamp == pytest.approx(sl.stamp_ns * 1e-9, abs=1e-6)


def test_the_image_stays_when_the_sdk_writes_its_next_one(sl: StandIn) -> None:
    dut = make()
    dut.open()
    image = dut.read()
    sl.depth[:] = 5.0

    assert image is not None
    assert image.depth[3, 3] == 2.0


def test_the_same_image_again_is_not_new(sl: StandIn) -> None:
    dut = make()
    dut.open()
    dut.read()

    assert dut.read() is None


def test_a_failed_grab_is_a_capture_error_but_a_reboot_passes(sl: StandIn) -> None:
    dut = make()
    dut.open()
    sl.grabbed = ERROR_CODE.CAMERA_REBOOTING
    assert dut.read() is None
    sl.grabbed = ERROR_CODE.CAMERA_NOT_DETECTED

    with pytest.raises(CaptureError, match="CAMERA_NOT_DETECTED"):
        dut.read()


def test_it_closes_once(sl: StandIn) -> None:
    dut = make()
    dut.close()
    dut.open()
    dut.close()
    dut.close()

    assert sl.closes == 1
