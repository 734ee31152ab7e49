"""Stereolabs ZED cameras, read by the ZED SDK's `pyzed`."""

import logging
from functools import partial
from typing import Any

import cv2
import numpy as np

from poil_drake.errors import CaptureError, InvalidValueError, MissingDependencyError
from poil_drake.perception.capture.checks import check_intrinsics, checked_image
from poil_drake.perception.capture.config import Zed
from poil_drake.perception.capture.device import Clock
from poil_drake.perception.capture.stamps import HostStamps
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.runtime.interpreter_turns import TURNS

_SUCCESS = 0
"""Value of `sl.ERROR_CODE.SUCCESS`. Errors have greater values, warnings smaller ones."""

_PASSING = ("CAMERA_REBOOTING", "CORRUPTED_FRAME")
"""Transient states without an image: the SDK recovers the camera, or one image was bad."""

_OTHER_MODE = "CONFIGURATION_FALLBACK"
"""The state of a camera that is open, but not in the requested mode."""


class ZedDevice:
    """Reads the left image of a ZED and the depth measured from it; a `CaptureDevice`.

    Each warning of the SDK is logged once. See `Zed` for what the stamps mean.

    Tested without the SDK and without a camera. All names are from the SDK's documentation; the
    values of its error codes are from its C interface (5.x).
    """

    def __init__(self, config: Zed, *, camera: CameraModel, clock: Clock):
        """Loads the SDK without opening the camera.

        Args:
            config: Which camera to open, and how.
            camera: The camera's model in the scenario. Its image size must not exceed that of the
                configured resolution.
            clock: Returns the current time [s since the epoch].

        Raises:
            MissingDependencyError: if the SDK's Python API is not installed.
            InvalidValueError: if the SDK does not know the resolution or the depth mode.
        """
        try:
            import pyzed.sl
        except ImportError as error:
            raise MissingDependencyError(
                "pyzed, which reads ZED cameras, is not installed.",
                remedy="Install the ZED SDK from stereolabs.com, and run its get_python_api.py "
                "with this Python.",
            ) from error
        self._sl: Any = pyzed.sl
        self._config, self._model, self._clock = config, camera, clock
        self._source = f"Camera '{camera.name}' (ZED {config.serial or 'without a serial number'})"
        self._resolution = _named(self._sl.RESOLUTION, config.resolution, "resolution")
        self._depth_mode = _named(self._sl.DEPTH_MODE, config.depth_mode, "depth_mode")
        self._stamps = HostStamps(clock, source=self._source)
        self._warned: set[str] = set()
        self._runtime = self._sl.RuntimeParameters()
        self._image, self._depth = self._sl.Mat(), self._sl.Mat()
        self._camera: Any = None
        self._output: Any = None
        self._last_time = self._settled = 0.0

    def open(self) -> None:
        """Opens the camera; see `CaptureDevice.open`."""
        self._stamps.restart()
        sl, config = self._sl, self._config
        self._require_optimized()
        if not config.serial and (count := len(sl.Camera.get_device_list())) != 1:
            raise CaptureError(
                f"{self._source} cannot be chosen from {count} cameras; connected cameras: "
                f"{self._connected()}.",
                remedy="Plug in exactly one, or set `serial` in the scenario to the number on the "
                "camera.",
            )
        parameters = sl.InitParameters()
        parameters.camera_resolution = self._resolution
        parameters.camera_fps = config.fps
        parameters.depth_mode = self._depth_mode
        parameters.coordinate_units = sl.UNIT.METER
        parameters.sdk_verbose = 0
        # Self-calibration would change the intrinsics slightly each time.
        parameters.camera_disable_self_calib = True
        # Otherwise `grab` blocks for seconds when the camera is unplugged.
        parameters.async_grab_camera_recovery = True
        if config.serial:
            parameters.set_from_serial_number(config.serial)
        # `close` also closes a camera that did not open.
        self._camera = camera = sl.Camera()
        status = camera.open(parameters)
        if status.value > _SUCCESS or status.name == _OTHER_MODE:
            raise CaptureError(
                f"{self._source} does not open with {config.resolution} at {config.fps} images per "
                f"second: {status.name} ({status}); connected cameras: {self._connected()}.",
                remedy="Check that it is plugged in, that it supports this resolution and rate, "
                "and that no other program uses it. ZED_Diagnostic tests it.",
            )
        self._warn(status)
        self._output = self._output_size(camera)
        self._last_time = self._clock()
        self._settled = self._last_time + config.settle

    def read(self) -> RgbdImage | None:
        """Returns a new image; see `CaptureDevice.read`."""
        sl, camera = self._sl, self._camera
        status = camera.grab(self._runtime)
        TURNS.wait()
        stamp = None
        if status.name not in _PASSING:
            self._check(status)
            taken = camera.get_timestamp(sl.TIME_REFERENCE.IMAGE).get_nanoseconds()
            stamp = self._stamps.convert(taken * 1e-9)
        now = self._clock()
        if stamp is None:
            if now - self._last_time > self._config.silence:
                raise CaptureError(
                    f"{self._source} has sent no new image for {self._config.silence:g} s "
                    f"({status.name}).",
                    remedy="Check that it is plugged in, and run ZED_Diagnostic.",
                )
            return None
        self._last_time = now
        if now < self._settled:
            return None
        self._check(camera.retrieve_image(self._image, sl.VIEW.LEFT, sl.MEM.CPU, self._output))
        self._check(
            camera.retrieve_measure(self._depth, sl.MEASURE.DEPTH, sl.MEM.CPU, self._output)
        )
        return checked_image(
            cv2.cvtColor(self._image.get_data(), cv2.COLOR_BGRA2RGB),
            self._depth.get_data(),
            stamp=stamp - self._config.latency,
            size=(self._model.height, self._model.width),
            source=self._source,
        )

    def close(self) -> None:
        """Closes the camera; see `CaptureDevice.close`."""
        camera, self._camera, self._output = self._camera, None, None
        if camera is not None:
            camera.close()

    def _check(self, status: Any) -> None:
        if status.value > _SUCCESS:
            raise CaptureError(
                f"{self._source} failed with the status {status.name} ({status}).",
                remedy="Check that it is plugged in, and run ZED_Diagnostic.",
            )
        self._warn(status)

    def _warn(self, status: Any) -> None:
        if status.value < _SUCCESS and status.name not in self._warned:
            self._warned.add(status.name)
            logging.getLogger(__name__).warning("%s: %s (%s)", self._source, status.name, status)

    def _connected(self) -> str:
        devices = self._sl.Camera.get_device_list()
        return ", ".join(str(device.serial_number) for device in devices) or "none"

    def _require_optimized(self) -> None:
        """Raises a CaptureError if the SDK would first optimize the depth mode's network.

        The SDK's documentation does not mention the function used here. An SDK without the function
        is not checked.
        """
        sl, mode = self._sl, self._config.depth_mode
        network = getattr(getattr(sl, "AI_MODELS", None), f"{mode}_DEPTH", None)
        check = getattr(sl, "check_AI_model_status", None)
        if network is None or check is None:
            return
        status = check(network)
        get = status.get if isinstance(status, dict) else partial(getattr, status)
        if not get("optimized", True):
            raise CaptureError(
                f"{self._source}: the network of the depth mode {mode} is not yet optimized for "
                "this GPU. Optimizing it takes minutes, during which a control loop would stop.",
                remedy="Optimize it with ZED_Diagnostic, or set `depth_mode` to PERFORMANCE.",
            )

    def _output_size(self, camera: Any) -> Any:
        """Returns the scenario's size (`sl.Resolution`); checks that the camera can provide it."""
        height, width = self._model.height, self._model.width
        configuration = camera.get_camera_information().camera_configuration
        native = configuration.resolution
        if width > native.width or width * native.height != height * native.width:
            raise CaptureError(
                f"{self._source} has {native.width} x {native.height} pixels, which cannot be "
                f"scaled down to the scenario's {width} x {height}.",
                remedy="In the scenario, set a size that has the same aspect ratio and is not "
                "larger, with the calibration for it, or choose another resolution.",
            )
        lens, scale = configuration.calibration_parameters.left_cam, width / native.width
        cx, cy = (scale * (centre + 0.5) - 0.5 for centre in (lens.cx, lens.cy))
        K = np.array([[scale * lens.fx, 0.0, cx], [0.0, scale * lens.fy, cy], [0.0, 0.0, 1.0]])
        check_intrinsics(K, self._model, source=f"{self._source}, scaled to {width} x {height},")
        return self._sl.Resolution(width, height)


def _named(kinds: Any, name: str, field: str) -> Any:
    """Returns the member `name` of the SDK's enumeration `kinds`; `field` of `Zed` holds `name`."""
    names = [kind.name for kind in kinds if kind.name != "LAST"]
    if name not in names:
        raise InvalidValueError(
            f"Zed.{field} is '{name}', which this ZED SDK does not have.",
            remedy=f"Choose from: {', '.join(names)}.",
        )
    return kinds[name]
