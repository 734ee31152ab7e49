"""The capture devices of the hardware station's cameras, and the networks they use."""

from itertools import combinations
from pathlib import Path

from pydrake.systems.sensors import CameraConfig

from poil_drake.diagrams.scenario.drake_errors import DrakeErrorsExplained
from poil_drake.diagrams.scenario.hardware_config import (
    IMAGE_BUS_URL,
    CameraSource,
    HardwareConfig,
    LcmImages,
)
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.perception.capture.config import McapPlayback, OpenCvStreams, RealSense, Zed
from poil_drake.perception.capture.device import CaptureDevice, make_device
from poil_drake.perception.images import CameraModel
from poil_drake.recording.demonstration.camera_playback import CameraPlayback
from poil_drake.systems.cameras.lcm_cameras import LcmImageDevice
from poil_drake.systems.lcm.network import Clock

_USUAL_BUSES = (HardwareConfig().robot_bus, HardwareConfig().image_bus)


def BusUrl(scenario: Scenario, bus: str, usual: str) -> str:
    """Returns the URL of one of the scenario's LCM networks.

    Args:
        scenario: Defines the networks in `lcm_buses`.
        bus: Name of the network.
        usual: The URL to return if the scenario does not set one.

    Raises:
        ScenarioError: if `bus` is neither in `lcm_buses` nor a default of `HardwareConfig`, or if
            the network has a channel suffix.
    """
    params = scenario.lcm_buses.get(bus)
    if params is None:
        if bus not in _USUAL_BUSES:
            raise ScenarioError(
                f"poil.hardware names the LCM network '{bus}', which lcm_buses does not define.",
                remedy="Define it in lcm_buses, or choose one of: "
                f"{', '.join(scenario.lcm_buses)}.",
            )
        return usual
    if params.channel_suffix:
        raise ScenarioError(
            f"lcm_buses.{bus}.channel_suffix is '{params.channel_suffix}', but suffixes are not "
            "supported on hardware.",
            remedy="Leave the suffix out, and set full channel names in poil.hardware.channels and "
            "in each !LcmImages.",
        )
    return params.lcm_url or usual


def ImageChannel(source: LcmImages, camera: str) -> str:
    """Returns the LCM channel of a camera's images."""
    return source.channel or f"DRAKE_RGBD_CAMERA_IMAGES_{camera}"


def MakeCaptureDevice(
    source: CameraSource,
    scenario: Scenario,
    camera: CameraModel,
    *,
    clock: Clock,
    every_image: bool = False,
) -> CaptureDevice:
    """Returns the device that captures a camera's images.

    Args:
        source: The source of the images.
        scenario: Defines the LCM networks.
        camera: The camera's model.
        clock: Returns the current time [s since the epoch].
        every_image: Whether a device that is read late delivers every image rather than the newest,
            if it can: LCM images and recordings. Other devices have their own queues.

    Raises:
        PoilError: if the device cannot be used.
    """
    if isinstance(source, LcmImages):
        return LcmImageDevice(
            url=BusUrl(scenario, scenario.poil.hardware.image_bus, IMAGE_BUS_URL),
            channel=ImageChannel(source, camera.name),
            size=(camera.height, camera.width),
            every_image=every_image,
        )
    if isinstance(source, McapPlayback):
        return CameraPlayback(source, camera=camera, clock=clock, every_image=every_image)
    return make_device(source, camera=camera, clock=clock)


def SendsLabels(source: CameraSource) -> bool:
    """Returns whether a source sends label images."""
    return isinstance(source, LcmImages | McapPlayback) and source.labels


def CheckHardwareCameras(scenario: Scenario) -> None:
    """Checks the sources of the scenario's cameras, without opening a device.

    Raises:
        ScenarioError: naming a camera that the scenario does not have, two cameras of one kind
            whose serial numbers are equal or missing, a recording that does not exist, or depth
            that is not registered to colour.
    """
    cameras = scenario.poil.hardware.cameras
    for kind in (RealSense, Zed):
        same = {name: source for name, source in cameras.items() if isinstance(source, kind)}
        for (first, one), (second, other) in combinations(same.items(), 2):
            if one.serial and other.serial and one.serial != other.serial:
                continue
            raise ScenarioError(
                f"poil.hardware.cameras gives '{first}' the serial number '{one.serial}' and "
                f"'{second}' the serial number '{other.serial}': the two {kind.__name__} cameras "
                "cannot be told apart.",
                remedy="Set the serial of each to the number printed on the camera.",
            )
    for name, source in cameras.items():
        if isinstance(source, McapPlayback) and not Path(source.file).is_file():
            raise ScenarioError(
                f"poil.hardware.cameras.{name} plays '{source.file}', which does not exist.",
                remedy="Set its file to an existing recording (.mcap).",
            )
        if name not in scenario.cameras:
            raise ScenarioError(
                f"poil.hardware.cameras names '{name}', which is not among the cameras.",
                remedy=f"Choose one of: {', '.join(scenario.cameras)}.",
            )
        if isinstance(source, OpenCvStreams) and not _one_view(name, scenario.cameras[name]):
            raise ScenarioError(
                f"cameras.{name} has its depth camera (X_BD) beside its colour camera (X_BC), but "
                "!OpenCvStreams does not register depth to colour.",
                remedy="Use a source of depth in the view of the colour camera and leave X_BD out, "
                "or use !RealSense or !Zed, which register depth.",
            )


def _one_view(name: str, config: CameraConfig) -> bool:
    """Returns whether the colour and the depth camera of a configuration have one pose."""
    with DrakeErrorsExplained(
        f"cameras.{name}.X_BC or X_BD cannot be used", remedy="Use deterministic poses."
    ):
        X_BC, X_BD = config.X_BC.GetDeterministicValue(), config.X_BD.GetDeterministicValue()
    return bool(X_BC.IsNearlyEqualTo(X_BD, 1e-9))
