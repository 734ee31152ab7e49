"""A ZED, with a stand-in for its SDK.

The stand-in was not checked against the real SDK: classes, functions and parameters are from the
documentation of its Python API. The values of ERROR_CODE are those of the SDK's C interface (5.x).
What `check_AI_model_status` returns is not documented, so the device takes an object or a
dictionary.
"""

import sys
import time
from enum import Enum
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from capture_bench import CAMERA, SIZE, K

from poil_drake.errors import CaptureError, InvalidValueError
from poil_drake.perception.capture.config import Zed
from poil_drake.perception.capture.zed import ZedDevice

ERROR_CODE = Enum(
    "ERROR_CODE",
    {
        "SENSOR_CONFIGURATION_CHANGED": -6,
        "POTENTIAL_CALIBRATION_ISSUE": -5,
        "CONFIGURATION_FALLBACK": -4,
        "SENSORS_DATA_REQUIRED": -3,
        "CORRUPTED_FRAME": -2,
        "CAMERA_REBOOTING": -1,
        "SUCCESS": 0,
        "FAILURE": 1,
        "CAMERA_NOT_DETECTED": 4,
    },
)
AI_MODELS = Enum("AI_MODELS", "NEURAL_DEPTH")
RESOLUTION = Enum("RESOLUTION", "HD720 VGA LAST")
DEPTH_MODE = Enum("DEPTH_MODE", "NEURAL PERFORMANCE LAST")


class Mat:
    data = np.zeros(0)

    def get_data(self) -> np.ndarray:
        return self.data


class StandIn(ModuleType):
    """The SDK, with a camera of twice the scenario's size."""

    def __init__(self) -> None:
        super().__init__("pyzed.sl")
        self.ERROR_CODE, self.RESOLUTION, self.DEPTH_MODE = ERROR_CODE, RESOLUTION, DEPTH_MODE
        self.UNIT = SimpleNamespace(METER="metre")
        self.VIEW, self.MEASURE = SimpleNamespace(LEFT="left"), SimpleNamespace(DEPTH="depth")
        self.MEM, self.TIME_REFERENCE = SimpleNamespace(CPU="cpu"), SimpleNamespace(IMAGE="image")
        self.Mat, self.RuntimeParameters = Mat, SimpleNamespace
        self.Resolution = lambda width, height: SimpleNamespace(width=width, height=height)
        self.InitParameters = lambda: SimpleNamespace(set_from_serial_number=self.serials.append)
        self.AI_MODELS = AI_MODELS
        self.ai_status: object = SimpleNamespace(downloaded=True, optimized=True)
        self.check_AI_model_status = lambda model: self.ai_status
        self.serials: list[int] = []
        self.connected = [77]
        self.opened, self.grabbed, self.closes = ERROR_CODE.SUCCESS, ERROR_CODE.SUCCESS, 0
        self.native = SimpleNamespace(width=2 * SIZE[1], height=2 * SIZE[0])
        # Twice as large, with pixel centres at integers: 2 (c + 0.5) - 0.5.
        self.lens = SimpleNamespace(
            fx=2 * K[0, 0], fy=2 * K[1, 1], cx=2 * K[0, 2] + 0.5, cy=2 * K[1, 2] + 0.5
        )
        self.depth = np.full(SIZE, 2.0, np.float32)
        self.depth[0, :3] = np.nan, np.inf, -np.inf
        self.stamp_ns = time.time_ns()
        methods = {"__new__": lambda cls: self, "get_device_list": staticmethod(self._devices)}
        self.Camera = type("Camera", (), methods)

    def _devices(self) -> list[SimpleNamespace]:
        return [SimpleNamespace(serial_number=number) for number in self.connected]

    def open(self, parameters: SimpleNamespace) -> ERROR_CODE:
        self.parameters = parameters
        return self.opened

    def get_camera_information(self) -> SimpleNamespace:
        calibration = SimpleNamespace(left_cam=self.lens)
        return SimpleNamespace(
            camera_configuration=SimpleNamespace(
                resolution=self.native, calibration_parameters=calibration
            )
        )

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
    given = Zed(**{"latency": 0.0, "settle": 0.0, **config})  # type: ignore[arg-type]
    return ZedDevice(given, camera=CAMERA, clock=time.time)


def opened(**config: object) -> ZedDevice:
    device = make(**config)
    device.open()
    return device


@pytest.fixture
def dut(sl: StandIn) -> ZedDevice:
    """An open camera."""
    return opened()


def test_it_requests_metres_and_the_configured_camera(sl: StandIn) -> None:
    opened(serial=77, fps=15)

    assert sl.serials == [77]
    assert sl.parameters.coordinate_units == "metre"
    assert sl.parameters.camera_resolution is RESOLUTION.HD720
    assert sl.parameters.depth_mode is DEPTH_MODE.NEURAL
    assert sl.parameters.camera_fps == 15
    assert sl.parameters.camera_disable_self_calib is True


@pytest.mark.parametrize("field", ["resolution", "depth_mode"])
def test_a_name_that_the_sdk_lacks_is_rejected(sl: StandIn, field: str) -> None:
    with pytest.raises(InvalidValueError, match=field):
        make(**{field: "SHARP"})


def test_an_error_names_the_camera_and_the_connected_ones(sl: StandIn) -> None:
    sl.opened = ERROR_CODE.CAMERA_NOT_DETECTED

    with pytest.raises(CaptureError, match=r"'left' \(ZED 5\).*CAMERA_NOT_DETECTED.*77"):
        opened(serial=5)


@pytest.mark.parametrize(
    ("connected", "said"), [([], "0 cameras.*none"), ([5, 77], "2 cameras.*5, 77")]
)
def test_without_a_serial_number_there_must_be_exactly_one(
    sl: StandIn, connected: list[int], said: str
) -> None:
    sl.connected = connected

    with pytest.raises(CaptureError, match=f"'left'.*{said}"):
        opened()
    assert not hasattr(sl, "parameters")


@pytest.mark.parametrize("name", ["POTENTIAL_CALIBRATION_ISSUE", "SENSOR_CONFIGURATION_CHANGED"])
def test_a_warning_leaves_the_camera_open_and_is_logged_once(
    sl: StandIn, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    sl.opened = sl.grabbed = ERROR_CODE[name]

    assert opened().read() is not None
    assert [record.getMessage().count(name) > 0 for record in caplog.records] == [True]


def test_a_mode_other_than_the_requested_one_is_an_error(sl: StandIn) -> None:
    sl.opened = ERROR_CODE.CONFIGURATION_FALLBACK
    dut = make()

    with pytest.raises(CaptureError, match="CONFIGURATION_FALLBACK"):
        dut.open()
    dut.close()
    assert sl.closes == 1


@pytest.mark.parametrize(
    "status", [SimpleNamespace(optimized=False), {"downloaded": True, "optimized": False}]
)
def test_a_network_that_is_not_optimized_is_rejected_before_anything_is_opened(
    sl: StandIn, status: object
) -> None:
    sl.ai_status = status

    with pytest.raises(CaptureError, match=r"NEURAL.*not yet optimized.*ZED_Diagnostic"):
        opened()
    assert not hasattr(sl, "parameters")

    opened(depth_mode="PERFORMANCE")


def test_an_sdk_without_that_check_is_accepted(sl: StandIn) -> None:
    del sl.check_AI_model_status

    opened()


def test_intrinsics_other_than_the_scenarios_are_rejected(sl: StandIn) -> None:
    sl.lens.cx += 4.0

    with pytest.raises(CaptureError, match=r"scaled to 8 x 6, has .* 5\.50, 2\.50 px"):
        opened()


def test_images_are_dropped_while_the_exposure_adapts(sl: StandIn) -> None:
    assert opened(settle=1e6).read() is None


def test_a_camera_that_repeats_its_image_is_reported(sl: StandIn) -> None:
    dut = opened(silence=1e-9)
    assert dut.read() is not None

    with pytest.raises(CaptureError, match=r"no new image for 1e-09 s \(SUCCESS\)"):
        dut.read()


def test_an_image_is_rgb_with_depth_0_where_nothing_was_measured(
    sl: StandIn, dut: ZedDevice
) -> None:
    expected = np.full(SIZE, 2.0, np.float32)
    expected[0, :3] = 0.0

    image = dut.read()
    sl.depth[:] = 5.0  # The SDK reuses its memory for the next image.

    assert image is not None
    np.testing.assert_array_equal(image.rgb[2, 3], (3, 2, 1))
    np.testing.assert_array_equal(image.depth, expected)
    assert image.stamp == pytest.approx(sl.stamp_ns * 1e-9, abs=1e-6)


def test_a_reboot_passes_but_a_failed_grab_is_a_capture_error(sl: StandIn, dut: ZedDevice) -> None:
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
