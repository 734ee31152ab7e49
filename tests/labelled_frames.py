"""Frames with label images, of which the detector `label_image` gives exact masks."""

from dataclasses import replace

from poil_drake.diagrams.demonstration.recorder import MakeDemonstrationMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import MultiViewFrame
from poil_drake.recording.demonstration.demonstration import Demonstration


def labelled(demonstration: Demonstration, scenario: Scenario) -> Demonstration:
    """Returns a scenario's built-in demonstration with label images in its first frame."""
    scene = DemonstrationScene(scenario)
    scene.put_object(MakeDemonstrationMotion(scene, scenario.poil.demonstration_motion).pose(0.0))
    first = scene.capture(0.0, labels=True)
    return replace(demonstration, frames=(first, *demonstration.frames[1:]))


def exact_masks(frame: MultiViewFrame, object_label: str = "mug") -> PartMasks:
    """Returns the masks of an object and its handle."""
    return LabelImageDetector().detect(frame, object_label=object_label, part_label="handle")
