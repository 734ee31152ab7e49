"""What reads each camera of the hardware station, and on which networks."""

from poil_drake.diagrams.hardware_config import IMAGE_BUS_URL, CameraSource, LcmImages
from poil_drake.diagrams.scenario import Scenario
from poil_drake.errors import ScenarioError
from poil_drake.perception.capture.config import McapPlayback
from poil_drake.perception.capture.device import CaptureDevice
from poil_drake.perception.capture.registry import make_device
from poil_drake.perception.images import CameraModel
from poil_drake.recording.camera_playback import CameraPlayback
from poil_drake.systems.lcm_image_device import LcmImageDevice
from poil_drake.systems.panda_lcm_messages import Clock


def BusUrl(scenario: Scenario, bus: str, usual: str) -> str:
    """Returns the address of one of the scenario's LCM networks, or the usual one."""
    params = scenario.lcm_buses.get(bus)
    return usual if params is None else params.lcm_url


def ImageChannel(source: LcmImages, camera: str) -> str:
    """Returns where the images of a camera are sent."""
    return source.channel or f"DRAKE_RGBD_CAMERA_IMAGES_{camera}"


def MakeCaptureDevice(
    source: CameraSource, scenario: Scenario, camera: CameraModel, *, clock: Clock
) -> CaptureDevice:
    """Returns what reads a camera.

    Args:
        source: Where its images come from.
        scenario: Its networks.
        camera: Its model.
        clock: The time now [s since the epoch].

    Raises:
        PoilError: if it cannot be used.
    """
    size = (camera.height, camera.width)
    if isinstance(source, LcmImages):
        return LcmImageDevice(
            url=BusUrl(scenario, scenario.poil.hardware.image_bus, IMAGE_BUS_URL),
            channel=ImageChannel(source, camera.name),
            size=size,
        )
    if isinstance(source, McapPlayback):
        return CameraPlayback(source, camera=camera.name, size=size, clock=clock)
    return make_device(source, camera=camera.name, size=size, clock=clock)


def CheckHardwareCameras(scenario: Scenario) -> None:
    """Checks that every camera for which a source is named is one of the scenario's.

    Raises:
        ScenarioError: naming one that is not.
    """
    for name in scenario.poil.hardware.cameras:
        if name not in scenario.cameras:
            raise ScenarioError(
                f"poil.hardware.cameras names '{name}', which is not among the cameras.",
                remedy=f"Choose one of: {', '.join(scenario.cameras)}.",
            )
