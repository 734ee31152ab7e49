"""Finds object and part in the demonstration and in the scene, by the scenario's detector."""

from dataclasses import dataclass

from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.by_hand.detector import HandLabelDetector
from poil_drake.perception.detectors.known_shape.detector import KnownShapeDetector
from poil_drake.perception.detectors.protocol import Detector, PartMasks
from poil_drake.perception.detectors.registry import BY_HAND, DEMONSTRATION, make_detector
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.transfer.demonstrated_object import find_demonstrated_object
from poil_drake.transfer.demonstration_tracks import DemonstrationTracks
from poil_drake.transfer.progress import Progress


@dataclass(frozen=True, eq=False)
class DetectedParts:
    """Object and part in the demonstration and in the scene.

    Attributes:
        source: Their masks in the demonstration's first frame.
        target: Their masks in the scene.
        tracks: Tracks of points of the demonstrated object, if the detector needed them.
    """

    source: PartMasks
    target: PartMasks
    tracks: DemonstrationTracks | None


def DetectParts(
    poil: PoilConfig,
    demonstration: Demonstration,
    frame: MultiViewFrame,
    *,
    tracker: Tracker,
    progress: Progress | None = None,
) -> DetectedParts:
    """Finds object and part in the demonstration and in a view of the scene.

    Args:
        poil: Names the detector, the object and the part.
        demonstration: The demonstration.
        frame: The scene, without the robot.
        tracker: Tracks the demonstrated object, if the detector needs that.
        progress: Called with the current activity and its completed fraction.

    Raises:
        DetectionError: if an object or a part is not found.
        TrackingError: if the tracker loses the object in the demonstration.
    """
    detector: Detector
    if poil.detector == DEMONSTRATION:
        shown = find_demonstrated_object(
            demonstration, table_height=poil.table_height, tracker=tracker, progress=progress
        )
        source, tracks = shown.masks, shown.tracks
        detector = KnownShapeDetector(
            shown.shape, table_height=poil.table_height, background=shown.fixture
        )
    else:
        tracks = None
        if poil.detector == BY_HAND:
            detector = HandLabelDetector(poil.labels)
        else:
            detector = make_detector(
                poil.detector, poil.detector_config, table_height=poil.table_height
            )
        first = f"the first frame of the demonstration '{demonstration.name}'"
        label = poil.demonstration_object_label or poil.object
        source = _detect(detector, demonstration.frames[0], first, label, poil.part)
    target = _detect(detector, frame, "the view of the scene", poil.object, poil.part)
    return DetectedParts(source, target, tracks)


def _detect(
    detector: Detector, frame: MultiViewFrame, where: str, object_label: str, part_label: str
) -> PartMasks:
    try:
        return detector.detect(frame, object_label=object_label, part_label=part_label)
    except DetectionError as error:
        raise DetectionError(f"In {where}: {error.problem}", remedy=error.remedy) from error
