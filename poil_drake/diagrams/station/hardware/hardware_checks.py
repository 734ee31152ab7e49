"""Checks that a scenario can run on hardware. The checks open no device."""

from pathlib import Path

from poil_drake.diagrams.scenario.hardware_config import LcmImages
from poil_drake.diagrams.scenario.scenario import GROUND_TRUTH, Scenario
from poil_drake.diagrams.station.cameras.capture_sources import SendsLabels
from poil_drake.errors import ScenarioError
from poil_drake.perception.capture.config import McapPlayback
from poil_drake.perception.detectors.registry import LABEL_IMAGE


def CheckHardwareRun(scenario: Scenario) -> None:
    """Checks that the scenario's tracker, detector and cameras can be used on hardware.

    Raises:
        ScenarioError: naming what cannot be used, or a recording that does not exist.
    """
    if scenario.poil.tracker == GROUND_TRUTH:
        raise ground_truth_error()
    for name in scenario.cameras:
        source = scenario.poil.hardware.cameras.get(name, LcmImages())
        if scenario.poil.detector == LABEL_IMAGE and not SendsLabels(source):
            raise label_error(name)
        if isinstance(source, McapPlayback) and not Path(source.file).is_file():
            raise ScenarioError(
                f"poil.hardware.cameras.{name} plays '{source.file}', which does not exist.",
                remedy="Set its file to an existing recording (.mcap).",
            )


def ground_truth_error() -> ScenarioError:
    """Returns the error for a ground-truth tracker on hardware."""
    return ScenarioError(
        f"The tracker '{GROUND_TRUTH}' needs the simulator's poses, which hardware does not have.",
        remedy="Set poil.tracker to one that uses cameras, e.g. rigid_flow.",
    )


def label_error(camera: str) -> ScenarioError:
    """Returns the error for a camera without the label images that the detector reads."""
    return ScenarioError(
        f"The detector '{LABEL_IMAGE}' reads label images, "
        f"which camera '{camera}' does not provide.",
        remedy="Use a source with label images: a segmentation node that sends images and labels "
        f"over LCM (poil.hardware.cameras.{camera}: !LcmImages {{}}), or a recording that contains "
        "labels (!McapPlayback).",
    )
