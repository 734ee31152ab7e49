import dataclasses

import numpy as np
import pytest

from poil_drake.diagrams.scenario.hardware_config import IMAGE_BUS_URL, CameraSource, LcmImages
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.cameras.capture_sources import (
    BusUrl,
    CheckHardwareCameras,
    ImageChannel,
    MakeCaptureDevice,
    SendsLabels,
)
from poil_drake.errors import ScenarioError
from poil_drake.perception.capture.config import McapPlayback, OpenCvStreams, RealSense, Zed
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


def test_an_undefined_network_has_the_default_address() -> None:
    scenario = ChooseScenario(data="{lcm_buses: {lab: {lcm_url: 'memq://lab'}}}")

    assert BusUrl(scenario, "images", IMAGE_BUS_URL) == IMAGE_BUS_URL
    assert BusUrl(scenario, "lab", IMAGE_BUS_URL) == "memq://lab"


@pytest.mark.parametrize(
    ("bus", "says"),
    [
        ("franka", "'franka', which lcm_buses does not define.*one of: default, lab, right, open"),
        ("right", "lcm_buses.right.channel_suffix is '_RIGHT'"),
    ],
)
def test_an_unsuitable_network_is_refused(bus: str, says: str) -> None:
    scenario = ChooseScenario(
        data="{lcm_buses: {lab: {lcm_url: 'memq://l'}, right: {channel_suffix: _RIGHT}, open: {}}}"
    )

    with pytest.raises(ScenarioError, match=says):
        BusUrl(scenario, bus, IMAGE_BUS_URL)
    # Without a URL, LCM would read the environment.
    assert BusUrl(scenario, "open", IMAGE_BUS_URL) == IMAGE_BUS_URL


def test_images_are_on_drakes_channel_by_default() -> None:
    assert ImageChannel(LcmImages(), "left") == "DRAKE_RGBD_CAMERA_IMAGES_left"
    named = dataclasses.replace(LcmImages(), channel="LAB_LEFT")
    assert ImageChannel(named, "left") == "LAB_LEFT"


@pytest.mark.parametrize(
    ("source", "labelled"),
    [
        (LcmImages(), True),
        (LcmImages(labels=False), False),
        (McapPlayback(), True),
        (McapPlayback(labels=False), False),
        (RealSense(), False),
        (Zed(), False),
        (OpenCvStreams(), False),
    ],
)
def test_only_messages_and_recordings_have_labels(source: CameraSource, labelled: bool) -> None:
    assert SendsLabels(source) is labelled


def with_cameras(text: str) -> Scenario:
    return ChooseScenario(data=f"{{poil: {{hardware: {{cameras: {{{text}}}}}}}}}")


SAME_DEVICE = "'left' .*'right' .*cannot be told"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("left: !RealSense {}, right: !RealSense {}", SAME_DEVICE),
        ("left: !RealSense {serial: '1'}, right: !RealSense {}", SAME_DEVICE),
        ("left: !RealSense {serial: '1'}, right: !RealSense {serial: '1'}", SAME_DEVICE),
        ("left: !Zed {}, right: !Zed {serial: 7}", SAME_DEVICE),
        ("left: !Zed {serial: 7}, right: !Zed {serial: 7}", SAME_DEVICE),
        ("top: !LcmImages {}", "names 'top'"),
        ("left: !McapPlayback {file: no.mcap}", "left plays '.*no.mcap'"),
    ],
)
def test_unsuitable_cameras_are_refused(text: str, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        CheckHardwareCameras(with_cameras(text))


@pytest.mark.parametrize("key", ["X_BC", "X_BD"])
def test_depth_beside_colour_needs_a_source_that_registers_it(key: str) -> None:
    beside = f"cameras: {{left: {{{key}: {{translation: [0.015, 0, 0]}}}}}}"
    for source, registers in (
        ("OpenCvStreams {rgb: '0', depth: '1'}", False),
        ("RealSense {}", True),
    ):
        scenario = ChooseScenario(
            data=f"{{{beside}, poil: {{hardware: {{cameras: {{left: !{source}}}}}}}}}"
        )
        if registers:
            CheckHardwareCameras(scenario)
            continue
        with pytest.raises(ScenarioError, match=r"cameras\.left has its depth camera \(X_BD\)"):
            CheckHardwareCameras(scenario)


@pytest.mark.parametrize(
    "text",
    [
        "left: !RealSense {}",
        "left: !RealSense {serial: '1'}, right: !RealSense {serial: '2'}",
        "left: !RealSense {}, right: !Zed {}",
        "left: !LcmImages {}, right: !LcmImages {}",
    ],
)
def test_distinguishable_cameras_are_accepted(text: str) -> None:
    CheckHardwareCameras(with_cameras(text))
