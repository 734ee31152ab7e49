import dataclasses

import numpy as np
import pytest

from poil_drake.diagrams.capture_sources import BusUrl, ImageChannel, MakeCaptureDevice
from poil_drake.diagrams.hardware_config import IMAGE_BUS_URL, CameraSource, LcmImages
from poil_drake.diagrams.scenario_choice import ChooseScenario
from poil_drake.perception.capture.config import McapPlayback, OpenCvStreams
from poil_drake.perception.images import CameraModel

CAMERA = CameraModel(name="left", width=64, height=48, K=np.eye(3), X_WC=np.eye(4))


@pytest.mark.parametrize(
    ("source", "name"),
    [
        (LcmImages(), "LcmImageDevice"),
        (McapPlayback(file="lab.mcap"), "CameraPlayback"),
        (OpenCvStreams(rgb="0", depth="1"), "OpenCvStreamsDevice"),
    ],
)
def test_the_source_chooses_the_device(source: CameraSource, name: str) -> None:
    device = MakeCaptureDevice(source, ChooseScenario(), CAMERA, clock=lambda: 0.0)

    assert type(device).__name__ == name


def test_a_network_that_the_scenario_does_not_define_is_the_usual_one() -> None:
    scenario = ChooseScenario(data="{lcm_buses: {lab: {lcm_url: 'memq://lab'}}}")

    assert BusUrl(scenario, "images", IMAGE_BUS_URL) == IMAGE_BUS_URL
    assert BusUrl(scenario, "lab", IMAGE_BUS_URL) == "memq://lab"


def test_images_come_on_drakes_own_channel_unless_another_is_named() -> None:
    assert ImageChannel(LcmImages(), "left") == "DRAKE_RGBD_CAMERA_IMAGES_left"
    named = dataclasses.replace(LcmImages(), channel="LAB_LEFT")
    assert ImageChannel(named, "left") == "LAB_LEFT"
