"""Checks that a demonstration is possible, and that its cameras see the part."""

from pathlib import Path

import numpy as np

from poil_drake.diagrams.demonstration.motion import KeyframeMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.scenario.penetrations import START_TOLERANCE
from poil_drake.diagrams.scenario.poil_config import PoilConfig
from poil_drake.errors import DetectionError, ScenarioError, TransferError
from poil_drake.geometry.depth_image import pixel_size
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.registry import DEMONSTRATION
from poil_drake.perception.images import MultiViewFrame
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.reports.progress import ProgressBar
from poil_drake.transfer.demonstrated_object import find_demonstrated_object
from poil_drake.transfer.part_points import sample_part_points, view_part


def CheckMotion(
    scene: DemonstrationScene, motion: KeyframeMotion, times: np.ndarray, poil: PoilConfig
) -> None:
    """Checks that the object starts standing on something, and goes through nothing.

    It may be inside a mesh of the fixture: meshes count as convex hulls, which have no openings.

    Args:
        scene: The scene.
        motion: The object's motion.
        times: (T,) times to check [s], the first of them 0.
        poil: Names the keys to change.

    Raises:
        ScenarioError: if the object starts in the air or inside another, or moves through another.
    """
    if not scene.has_collision_geometry:
        return
    if poil.demonstration_motion.keyframes:
        remedy = later = "Change poil.demonstration_motion.keyframes."
    else:
        later = (
            "Use a smaller object (poil.demonstration_object) or a higher fixture, move what is in "
            "the way, or set poil.demonstration_motion.keyframes."
        )
        remedy = (
            "Set poil.table_height to the height of the surface on which objects stand, and "
            "poil.demonstration_motion.hanging.start to a free place on it."
        )
    lowered = motion.pose(0.0)
    lowered[2, 3] -= START_TOLERANCE
    if not scene.penetrations(lowered):
        raise ScenarioError(
            f"The demonstration's object starts in the air, with its frame at "
            f"{_text(motion.pose(0.0))}: nothing is within {1000 * START_TOLERANCE:.0f} mm below "
            "it.",
            remedy=remedy,
        )
    for time in times.tolist():
        for found in scene.penetrations(motion.pose(time)):
            is_fixture = found.geometry.startswith(f"{scene.fixture_name}::")
            if found.depth <= START_TOLERANCE or (is_fixture and found.is_mesh):
                continue
            raise ScenarioError(
                f"The demonstration's object is inside '{found.geometry}' "
                f"{f'{time:.2f} s after its start' if time else 'at its start'}, with its frame at "
                f"{_text(motion.pose(time))}.",
                remedy=later if time else remedy,
            )


def CheckView(frame: MultiViewFrame, poil: PoilConfig) -> None:
    """Checks that a demonstration's first frame, with labels, shows enough of the part.

    Raises:
        ScenarioError: if it shows too little, or if its pixels are too coarse.
    """
    try:
        masks = LabelImageDetector().detect(frame, object_label=poil.object, part_label=poil.part)
        view = view_part(frame, masks)
        sample_part_points(view.part, poil.num_points)
    except (DetectionError, TransferError) as error:
        ids = frame.label_ids[poil.object]
        seen = []
        for camera, image in zip(frame.cameras, frame.images, strict=True):
            mask = np.isin([] if image.label is None else image.label, ids)
            if mask.any():
                size = pixel_size(mask, image.depth, camera.K)
                seen.append(f"'{camera.name}' ({1000 * size:.1f} mm for each pixel)")
        raise ScenarioError(
            f"The cameras show too little of the part '{poil.part}' in the demonstration's first "
            f"frame. {error.problem} These cameras see the object: {', '.join(seen) or 'none'}.",
            remedy="Turn or move the object by poil.demonstration_motion, move a camera (X_PB), or "
            "give the cameras more pixels (width and height).",
        ) from error


def CheckRecording(path: Path, poil: PoilConfig) -> None:
    """Checks that a finished recording shows object, part and fixture as the detector needs it.

    Raises:
        DetectionError: if they cannot be found.
        TrackingError: if the tracker loses the object.
    """
    if poil.detector == DEMONSTRATION:
        with ProgressBar() as progress:
            find_demonstrated_object(
                load_demonstration(path),
                table_height=poil.table_height,
                tracker=MakeScenarioTracker(poil),
                progress=progress,
            )


def _text(pose: np.ndarray) -> str:
    return f"({', '.join(f'{x:.3f}' for x in pose[:3, 3])}) m"
