"""Intel RealSense cameras, by `pyrealsense2`."""

from contextlib import suppress
from typing import Any

import numpy as np

from poil_drake.errors import CaptureError, MissingDependencyError
from poil_drake.perception.capture.checked_image import checked_image
from poil_drake.perception.capture.config import RealSense
from poil_drake.perception.capture.device import PATIENCE, Clock
from poil_drake.perception.capture.host_stamps import HostStamps
from poil_drake.perception.images import RgbdImage

_SECONDS_PER_MILLISECOND = 1e-3


class RealSenseDevice:
    """A RealSense with colour and depth, its depth aligned to colour; a `CaptureDevice`.

    See `RealSense` for what the stamps mean.
    """

    def __init__(self, config: RealSense, *, camera: str, size: tuple[int, int], clock: Clock):
        """Loads the library; the camera is not touched.

        Args:
            config: Which camera, and how it is run.
            camera: Its name in the scenario.
            size: (height, width) of its colour images [px].
            clock: The time now [s since the epoch].

        Raises:
            MissingDependencyError: if `pyrealsense2` is not installed.
        """
        self._rs = _load()
        self._config, self._size, self._clock = config, size, clock
        self._source = f"Camera '{camera}' (RealSense {config.serial or 'without a serial number'})"
        self._stamps = HostStamps(clock, source=self._source)
        self._pipeline: Any = None
        self._align: Any = None
        self._depth_scale = np.float32(0.0)
        self._heard = 0.0

    def open(self) -> None:
        """See `CaptureDevice.open`."""
        self._stamps.restart()
        rs = self._rs
        try:
            context = rs.context()
            serial = self._choose(_serials(rs, context))
            pipeline = rs.pipeline(context)
            device = pipeline.start(self._streams(serial)).get_device()
            self._pipeline = pipeline
            for sensor in device.query_sensors():
                if sensor.supports(rs.option.global_time_enabled):
                    sensor.set_option(rs.option.global_time_enabled, 1.0)
            self._depth_scale = np.float32(device.first_depth_sensor().get_depth_scale())
            self._align = rs.align(rs.stream.color)
        except RuntimeError as error:
            height, width = self._size
            raise CaptureError(
                f"{self._source} does not start with {width} x {height} pixels at "
                f"{self._config.fps} per second: {error}.",
                remedy="Choose a size and a rate that it has (rs-enumerate-devices lists them), "
                "use a USB 3 port, and end other programs that use it.",
            ) from error
        self._heard = self._clock()

    def read(self) -> RgbdImage | None:
        """See `CaptureDevice.read`."""
        if self._pipeline is None:
            raise CaptureError(f"{self._source} is not open.", remedy="Open it first.")
        try:
            return self._read()
        except RuntimeError as error:
            raise CaptureError(
                f"{self._source} failed: {error}.",
                remedy="See whether it is plugged in, and into a USB 3 port.",
            ) from error

    def close(self) -> None:
        """See `CaptureDevice.close`."""
        pipeline, self._pipeline, self._align = self._pipeline, None, None
        if pipeline is not None:
            # An unplugged camera cannot be stopped.
            with suppress(RuntimeError):
                pipeline.stop()

    def _read(self) -> RgbdImage | None:
        _, frames = self._pipeline.try_wait_for_frames(round(PATIENCE / _SECONDS_PER_MILLISECOND))
        # The first frames come without their partners, and none at all when the time is over.
        if not (frames and frames.get_color_frame() and frames.get_depth_frame()):
            self._silent()
            return None
        frames = self._align.process(frames)
        color, depth = frames.get_color_frame(), frames.get_depth_frame()
        if not (color and depth):
            self._silent()
            return None
        self._heard = self._clock()
        stamp = self._stamp(color)
        if stamp is None:
            return None
        metres = np.multiply(np.asanyarray(depth.get_data()), self._depth_scale, dtype=np.float32)
        return checked_image(
            np.asanyarray(color.get_data()),
            metres,
            stamp=stamp,
            size=self._size,
            source=self._source,
        )

    def _stamp(self, frame: Any) -> float | None:
        if frame.get_frame_timestamp_domain() == self._rs.timestamp_domain.global_time:
            return self._stamps.convert(frame.get_timestamp() * _SECONDS_PER_MILLISECOND)
        return self._clock() - self._config.latency

    def _silent(self) -> None:
        """The library does not say that a camera was unplugged: it only becomes silent."""
        if self._clock() - self._heard <= self._config.silence:
            return
        raise CaptureError(
            f"{self._source} has sent no image for {self._config.silence:g} s; connected are: "
            f"{', '.join(_serials(self._rs, self._rs.context())) or 'none'}.",
            remedy="See whether it is plugged in, and into a USB 3 port.",
        )

    def _choose(self, serials: list[str]) -> str:
        wanted = self._config.serial
        if wanted in serials:
            return wanted
        if not wanted and len(serials) == 1:
            return serials[0]
        raise CaptureError(
            f"{self._source} was not found; connected are: {', '.join(serials) or 'none'}.",
            remedy="Plug it in, and give it in the scenario the serial number printed on it."
            if not wanted
            else "Plug it in, or correct its serial number in the scenario.",
        )

    def _streams(self, serial: str) -> Any:
        rs, fps, (height, width) = self._rs, self._config.fps, self._size
        depth_width = self._config.depth_width or width
        depth_height = self._config.depth_height or height
        streams = rs.config()
        streams.enable_device(serial)
        streams.enable_stream(rs.stream.color, width, height, rs.format.rgb8, fps)
        streams.enable_stream(rs.stream.depth, depth_width, depth_height, rs.format.z16, fps)
        return streams


def _serials(rs: Any, context: Any) -> list[str]:
    return [
        device.get_info(rs.camera_info.serial_number)
        for device in context.query_devices()
        if device.supports(rs.camera_info.serial_number)
    ]


def _load() -> Any:
    try:
        import pyrealsense2
    except ImportError as error:
        raise MissingDependencyError(
            "pyrealsense2, which reads RealSense cameras, is not installed.",
            remedy="Install it with: pip install pyrealsense2",
        ) from error
    return pyrealsense2
