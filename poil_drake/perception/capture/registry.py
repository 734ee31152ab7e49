"""Creates the device that reads a camera, by the type of the configuration."""

from importlib import import_module

from poil_drake.errors import InvalidValueError
from poil_drake.perception.capture.config import OpenCvStreams, RealSense, Zed
from poil_drake.perception.capture.device import CaptureDevice, Clock
from poil_drake.perception.images import CameraModel

# Modules and classes, by name so that only the device in use is imported.
_DEVICES: dict[type, tuple[str, str]] = {
    RealSense: ("poil_drake.perception.capture.real_sense", "RealSenseDevice"),
    Zed: ("poil_drake.perception.capture.zed", "ZedDevice"),
    OpenCvStreams: ("poil_drake.perception.capture.opencv_streams", "OpenCvStreamsDevice"),
}


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
        InvalidValueError: if the configuration is incomplete or of an unknown type.
    """
    if type(config) not in _DEVICES:
        raise InvalidValueError(
            f"Camera '{camera.name}' has the unsupported source type {type(config).__name__}.",
            remedy=f"Use one of: {', '.join(kind.__name__ for kind in _DEVICES)}.",
        )
    module, name = _DEVICES[type(config)]
    device: CaptureDevice = getattr(import_module(module), name)(config, camera=camera, clock=clock)
    return device
