"""Intel RealSense cameras, read by `pyrealsense2`."""

from contextlib import suppress
from typing import Any

import numpy as np

from poil_drake.errors import CaptureError, MissingDependencyError
from poil_drake.perception.capture.checks import check_intrinsics, checked_image
from poil_drake.perception.capture.config import RealSense
from poil_drake.perception.capture.device import PATIENCE, Clock
from poil_drake.perception.capture.rectification import Rectification
from poil_drake.perception.capture.stamps import FramePairStamps
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.runtime.interpreter_turns import TURNS


class RealSenseDevice:
    """Reads a RealSense, with depth aligned to colour; a `CaptureDevice`.

    Images are undistorted with the camera's own calibration, which must agree with the scenario's.
    See `RealSense` for what the stamps mean.

    Tested without a camera, but against the library's names and types.
    """

    def __init__(self, config: RealSense, *, camera: CameraModel, clock: Clock):
        """Loads the library without opening the camera.

        Args:
            config: Which camera to open, and how.
            camera: The camera's model in the scenario.
            clock: Returns the current time [s since the epoch].

        Raises:
            MissingDependencyError: if `pyrealsense2` is not installed.
        """
        try:
            import pyrealsense2
        except ImportError as error:
            raise MissingDependencyError(
                "pyrealsense2, which reads RealSense cameras, is not installed.",
                remedy="Install it with: pip install pyrealsense2",
            ) from error
        self._rs: Any = pyrealsense2
        self._config, self._camera, self._clock = config, camera, clock
        self._size = (camera.height, camera.width)
        serial = config.serial or "without a serial number"
        self._source = f"Camera '{camera.name}' (RealSense {serial})"
        self._stamps = FramePairStamps(
            self._rs, clock, source=self._source, fps=config.fps, latency=config.latency
        )
        self._align = self._rs.align(self._rs.stream.color)
        self._pipeline: Any = None
        self._rectification: Rectification  # Set by `open`.
        self._depth_step = 0.0
        self._last_time = self._settled = 0.0

    def open(self) -> None:
        """Opens the camera; see `CaptureDevice.open`."""
        self._stamps.restart()
        rs, fps, (height, width) = self._rs, self._config.fps, self._size
        depth_width = self._config.depth_width or width
        depth_height = self._config.depth_height or height
        try:
            context = rs.context()
            streams = rs.config()
            streams.enable_device(self._choose(_serials(rs, context)))
            streams.enable_stream(rs.stream.color, width, height, rs.format.rgb8, fps)
            streams.enable_stream(rs.stream.depth, depth_width, depth_height, rs.format.z16, fps)
            pipeline = rs.pipeline(context)
            profile = pipeline.start(streams)
            self._pipeline = pipeline
            device = profile.get_device()
            for sensor in device.query_sensors():
                if sensor.supports(rs.option.global_time_enabled):
                    sensor.set_option(rs.option.global_time_enabled, 1.0)
            self._depth_step = device.first_depth_sensor().get_depth_scale()
            stream = profile.get_stream(rs.stream.color).as_video_stream_profile()
            intrinsics = stream.get_intrinsics()
        except RuntimeError as error:
            raise CaptureError(
                f"{self._source} does not start with {width} x {height} pixels at {fps} images "
                f"per second: {error}.",
                remedy="Choose a size and a rate that it supports (rs-enumerate-devices lists "
                "them), use a USB 3 port, and make sure that no other program uses it.",
            ) from error
        self._rectification = Rectification(rs, intrinsics, source=self._source)
        check_intrinsics(self._rectification.K, self._camera, source=self._source)
        self._last_time = self._clock()
        self._settled = self._last_time + self._config.settle

    def read(self) -> RgbdImage | None:
        """Returns a new image; see `CaptureDevice.read`."""
        try:
            return self._read()
        except RuntimeError as error:
            raise CaptureError(
                f"{self._source} failed: {error}.",
                remedy="Check that it is plugged into a USB 3 port.",
            ) from error

    def close(self) -> None:
        """Closes the camera; see `CaptureDevice.close`."""
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            with suppress(RuntimeError):  # An unplugged camera cannot be stopped.
                pipeline.stop()

    def _read(self) -> RgbdImage | None:
        _, frames = self._pipeline.try_wait_for_frames(round(PATIENCE * 1e3))  # [ms]
        TURNS.wait()
        stamp = self._stamps.stamp(frames)
        now = self._clock()
        if stamp is None:
            # The library reports no error when a camera is unplugged; it only delivers no frames.
            if now - self._last_time > self._config.silence:
                serials = ", ".join(_serials(self._rs, self._rs.context())) or "none"
                raise CaptureError(
                    f"{self._source} has sent no new image for {self._config.silence:g} s; "
                    f"connected cameras: {serials}.",
                    remedy="Check that it is plugged into a USB 3 port.",
                )
            return None
        self._last_time = now
        if now < self._settled:
            return None
        frames = self._align.process(frames)
        color, depth = frames.get_color_frame(), frames.get_depth_frame()
        if not (color and depth):
            return None
        return checked_image(
            self._rectification.color(np.asanyarray(color.get_data())),
            self._rectification.depth(np.asanyarray(depth.get_data())),
            stamp=stamp,
            size=self._size,
            source=self._source,
            depth_step=self._depth_step,
        )

    def _choose(self, serials: list[str]) -> str:
        wanted = self._config.serial
        if wanted in serials:
            return wanted
        if not wanted and len(serials) == 1:
            return serials[0]
        reason = "was not found" if wanted else f"cannot be chosen from {len(serials)} cameras"
        raise CaptureError(
            f"{self._source} {reason}; connected cameras: {', '.join(serials) or 'none'}.",
            remedy=f"Plug {'it in' if wanted else 'in exactly one'}, or set `serial` in the "
            "scenario to the number on the camera.",
        )


def _serials(rs: Any, context: Any) -> list[str]:
    return [
        device.get_info(rs.camera_info.serial_number)
        for device in context.query_devices()
        if device.supports(rs.camera_info.serial_number)
    ]
