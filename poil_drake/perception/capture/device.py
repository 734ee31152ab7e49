"""The protocol of RGB-D cameras, and the device for each configuration."""

from collections.abc import Callable
from importlib import import_module
from typing import Protocol

from poil_drake.perception.capture.config import OpenCvStreams, RealSense, Zed
from poil_drake.perception.images import CameraModel, RgbdImage

Clock = Callable[[], float]
"""Returns the current time [s since the epoch], possibly of a scaled clock."""

PATIENCE = 0.1
"""How long `CaptureDevice.read` may wait for an image [s]."""

# Modules and classes, by name so that only the device in use is imported.
_DEVICES: dict[type, tuple[str, str]] = {
    RealSense: ("poil_drake.perception.capture.real_sense", "RealSenseDevice"),
    Zed: ("poil_drake.perception.capture.zed", "ZedDevice"),
    OpenCvStreams: ("poil_drake.perception.capture.opencv_streams", "OpenCvStreamsDevice"),
}


class CaptureDevice(Protocol):
    """One RGB-D camera. All calls come from one thread, the capture thread.

    The stamp of an image is its time of capture, by the clock passed to the device.
    """

    def open(self) -> None:
        """Opens the camera; this may take seconds. After `close` it may be opened again.

        Raises:
            CaptureError: if the camera cannot be opened. The error names the camera and
                what was found instead.
        """

    def read(self) -> RgbdImage | None:
        """Waits at most PATIENCE for a new image; call `open` first.

        Returns:
            The image, whose arrays never change again, or None if none arrived.

        Raises:
            NoImageError: if an image is unusable, or if no more images will come. The camera stays
                open. After an unusable image, the next `read` may return a good one.
            CaptureError: if the camera has failed and has to be closed and opened again.
        """

    def close(self) -> None:
        """Closes the camera. Never raises; a second call does nothing."""


def make_device(
    config: RealSense | Zed | OpenCvStreams, *, camera: CameraModel, clock: Clock
) -> CaptureDevice:
    """Returns the device that reads a camera, without opening it.

    Args:
        config: Where the images come from.
        camera: The camera's model in the scenario.
        clock: Returns the current time [s since the epoch].

    Raises:
        MissingDependencyError: if the device's library is not installed.
        InvalidValueError: if the configuration is incomplete.
    """
    module, name = _DEVICES[type(config)]
    device: CaptureDevice = getattr(import_module(module), name)(config, camera=camera, clock=clock)
    return device
