"""Object and part of the package's demonstration and scene, by each kind of detector."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from box_scene import agreement
from labelled_frames import exact_masks, labelled

from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.run.detection import DetectedParts, DetectParts
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation, WithoutRobot
from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import MultiViewFrame
from poil_drake.recording.demonstration.demonstration import Demonstration, load_demonstration

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def frame(scenario: Scenario) -> MultiViewFrame:
    """The scene, with labels and without the robot."""
    station = MakeStation(scenario, ignore_output_delay=True)
    context = station.CreateDefaultContext()
    return WithoutRobot(station, context, CaptureFrame(station, context, labels=True))


@pytest.fixture(scope="module")
def recorded(demonstration: Path) -> Demonstration:
    return load_demonstration(demonstration)


def detect(scenario: Scenario, recorded: Demonstration, frame: MultiViewFrame) -> DetectedParts:
    poil = scenario.poil
    return DetectParts(poil, recorded, frame, tracker=MakeScenarioTracker(poil))


@pytest.fixture(scope="module")
def found(scenario: Scenario, recorded: Demonstration, frame: MultiViewFrame) -> DetectedParts:
    """What the scenario's detector finds without labels."""
    unlabelled = tuple(replace(image, label=None) for image in frame.images)
    return detect(scenario, recorded, replace(frame, images=unlabelled, label_ids={}))


def check(masks: PartMasks, exact: PartMasks) -> None:
    precision, recall = agreement(masks.object_masks, exact.object_masks)
    assert precision > 0.97
    assert recall > 0.85
    precision, recall = agreement(masks.part_masks, exact.part_masks)
    assert precision > 0.8
    assert recall > 0.7


def test_the_demonstration_shows_mug_and_handle(
    found: DetectedParts, recorded: Demonstration, scenario: Scenario
) -> None:
    check(found.source, exact_masks(labelled(recorded, scenario).frames[0]))


def test_the_scenes_mug_and_handle_are_found(found: DetectedParts, frame: MultiViewFrame) -> None:
    check(found.target, exact_masks(frame))


def test_tracks_cover_the_demonstration(found: DetectedParts, recorded: Demonstration) -> None:
    assert found.tracks is not None
    assert found.tracks.times[-1] == pytest.approx(recorded.duration)


def test_a_scene_without_the_object_is_named(
    scenario: Scenario, recorded: Demonstration, frame: MultiViewFrame
) -> None:
    mug = exact_masks(frame).object_masks
    images = tuple(
        replace(image, depth=np.where(mask, 0.0, image.depth))
        for image, mask in zip(frame.images, mug, strict=True)
    )

    with pytest.raises(DetectionError, match="In the view of the scene: None of the 0 objects"):
        detect(scenario, recorded, replace(frame, images=images))


@pytest.fixture(scope="module")
def cup(recorded: Demonstration, scenario: Scenario) -> Demonstration:
    """The demonstration with labels, in which the mug is called a cup."""
    with_labels = labelled(recorded, scenario)
    first = with_labels.frames[0]
    ids = {name.replace("mug", "cup"): ids for name, ids in first.label_ids.items()}
    frames = (replace(first, label_ids=ids), *with_labels.frames[1:])
    return replace(with_labels, frames=frames, name="cup.mcap")


def by_label(scenario: Scenario, **names: str) -> Scenario:
    return replace(scenario, poil=replace(scenario.poil, detector="label_image", **names))


def test_labels_give_exact_masks_and_no_tracks(
    scenario: Scenario, cup: Demonstration, frame: MultiViewFrame
) -> None:
    dut = detect(by_label(scenario, demonstration_object_label="cup"), cup, frame)

    assert agreement(dut.source.part_masks, exact_masks(cup.frames[0], "cup").part_masks) == (1, 1)
    assert agreement(dut.target.object_masks, exact_masks(frame).object_masks) == (1, 1)
    assert dut.tracks is None


@pytest.mark.parametrize(
    ("names", "says"),
    [
        ({}, "first frame of the demonstration 'cup.mcap': .* no render label .* object 'mug'"),
        ({"demonstration_object_label": "cup", "part": "spout"}, "the part 'spout' of 'cup'"),
        (
            {"demonstration_object_label": "cup", "object": "teapot"},
            "In the view of the scene: The frame has no render label for the object 'teapot'",
        ),
    ],
)
def test_errors_name_the_images_in_which_a_detection_failed(
    scenario: Scenario,
    cup: Demonstration,
    frame: MultiViewFrame,
    names: dict[str, str],
    says: str,
) -> None:
    with pytest.raises(DetectionError, match=says):
        detect(by_label(scenario, **names), cup, frame)
