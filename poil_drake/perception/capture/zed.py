"""Stereolabs ZED cameras, by the ZED SDK's `pyzed`."""

from typing import Any

import cv2

from poil_drake.errors import CaptureError, InvalidValueError, MissingDependencyError
from poil_drake.perception.capture.checked_image import checked_image
from poil_drake.perception.capture.config import Zed
from poil_drake.perception.capture.device import Clock
from poil_drake.perception.capture.host_stamps import HostStamps
from poil_drake.perception.images import RgbdImage

_SECONDS_PER_NANOSECOND = 1e-9

# While the SDK recovers a camera by itself, and after a single bad image.
_PASSING = ("CAMERA_REBOOTING", "CORRUPTED_FRAME")


class ZedDevice:
    """A ZED with its left image and the depth seen from it; a `CaptureDevice`.

    See `Zed` for what the stamps mean.
    """

    def __init__(self, config: Zed, *, camera: str, size: tuple[int, int], clock: Clock):
        """Loads the SDK; the camera is not touched.

        Args:
            config: Which camera, and how it is run.
            camera: Its name in the scenario.
            size: (height, width) of the images [px], not larger than the camera's.
            clock: The time now [s since the epoch].

        Raises:
            MissingDependencyError: if the SDK's Python API is not installed.
            InvalidValueError: if the SDK does not know the resolution or the depth mode.
        """
        self._sl = _load()
        self._config, self._size, self._clock = config, size, clock
        self._source = f"Camera '{camera}' (ZED {config.serial or 'without a serial number'})"
        self._resolution = _named(self._sl.RESOLUTION, config.resolution, "resolution")
        self._depth_mode = _named(self._sl.DEPTH_MODE, config.depth_mode, "depth_mode")
        self._stamps = HostStamps(clock, source=self._source)
        self._camera: Any = None
        self._runtime: Any = None
        self._image: Any = None
        self._depth: Any = None
        self._output: Any = None
        self._heard = 0.0

    def open(self) -> None:
        """See `CaptureDevice.open`."""
        self._stamps.restart()
        sl, config = self._sl, self._config
        parameters = sl.InitParameters()
        parameters.camera_resolution = self._resolution
        parameters.camera_fps = config.fps
        parameters.depth_mode = self._depth_mode
        parameters.coordinate_units = sl.UNIT.METER
        parameters.sdk_verbose = 0
        # Else `grab` blocks for seconds when the camera is unplugged.
        parameters.async_grab_camera_recovery = True
        if config.serial:
            parameters.set_from_serial_number(config.serial)
        camera = sl.Camera()
        status = camera.open(parameters)
        if status != sl.ERROR_CODE.SUCCESS:
            camera.close()
            connected = [str(device.serial_number) for device in sl.Camera.get_device_list()]
            raise CaptureError(
                f"{self._source} does not open with {config.resolution} at {config.fps} per "
                f"second: {status.name} ({status}); connected are: "
                f"{', '.join(connected) or 'none'}.",
                remedy="Plug it in, end other programs that use it, and let ZED_Diagnostic look.",
            )
        self._camera = camera
        self._runtime = sl.RuntimeParameters()
        self._image, self._depth = sl.Mat(), sl.Mat()
        self._output = self._output_size(camera)
        self._heard = self._clock()

    def read(self) -> RgbdImage | None:
        """See `CaptureDevice.read`."""
        sl, camera = self._sl, self._camera
        if camera is None:
            raise CaptureError(f"{self._source} is not open.", remedy="Open it first.")
        status = camera.grab(self._runtime)
        if status.name in _PASSING:
            self._silent(status)
            return None
        self._check(status)
        self._heard = self._clock()
        taken = camera.get_timestamp(sl.TIME_REFERENCE.IMAGE).get_nanoseconds()
        stamp = self._stamps.convert(taken * _SECONDS_PER_NANOSECOND)
        if stamp is None:
            return None
        self._check(camera.retrieve_image(self._image, sl.VIEW.LEFT, sl.MEM.CPU, self._output))
        self._check(
            camera.retrieve_measure(self._depth, sl.MEASURE.DEPTH, sl.MEM.CPU, self._output)
        )
        return checked_image(
            cv2.cvtColor(self._image.get_data(), cv2.COLOR_BGRA2RGB),
            self._depth.get_data(),
            stamp=stamp - self._config.latency,
            size=self._size,
            source=self._source,
        )

    def close(self) -> None:
        """See `CaptureDevice.close`."""
        camera, self._camera = self._camera, None
        if camera is not None:
            camera.close()

    def _check(self, status: Any) -> None:
        if status != self._sl.ERROR_CODE.SUCCESS:
            raise CaptureError(
                f"{self._source} failed: {status.name} ({status}).",
                remedy="See whether it is plugged in, and let ZED_Diagnostic look.",
            )

    def _silent(self, status: Any) -> None:
        if self._clock() - self._heard > self._config.silence:
            self._check(status)

    def _output_size(self, camera: Any) -> Any:
        """Returns the wanted size, after checking that the camera's image can be scaled to it."""
        height, width = self._size
        native = camera.get_camera_information().camera_configuration.resolution
        if width > native.width or width * native.height != height * native.width:
            raise CaptureError(
                f"{self._source} has {native.width} x {native.height} pixels, which cannot be "
                f"scaled down to {width} x {height}.",
                remedy="Give the camera in the scenario a size of the same proportions, with the "
                "calibration for it, or choose another resolution.",
            )
        return self._sl.Resolution(width, height)


def _named(kinds: Any, name: str, field: str) -> Any:
    """Returns the member of one of the SDK's enumerations that has this name."""
    names = [kind.name for kind in kinds if kind.name != "LAST"]
    if name not in names:
        raise InvalidValueError(
            f"Zed.{field} is '{name}'.", remedy=f"This ZED SDK has: {', '.join(names)}."
        )
    return kinds[name]


def _load() -> Any:
    try:
        import pyzed.sl
    except ImportError as error:
        raise MissingDependencyError(
            "pyzed, which reads ZED cameras, is not installed.",
            remedy="Install the ZED SDK from stereolabs.com, and run its get_python_api.py with "
            "this Python.",
        ) from error
    return pyzed.sl
