"""From a demonstration and a view of the target to the target's reference (POIL section III-A)."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.control.reference.make_reference import ReferenceConfig
from poil_drake.errors import DetectionError, InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.perception.detectors.protocol import PartDetector
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.protocol import PointTracker
from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.transfer.alignment.coarse_alignment import CoarseAlignment
from poil_drake.transfer.alignment.config import CoarseAlignmentConfig
from poil_drake.transfer.alignment.symmetric_alignments import AmbiguityConfig, symmetric_alignments
from poil_drake.transfer.demonstration_tracks import DemonstrationTracks, track_demonstration
from poil_drake.transfer.matching import Matching, make_matching_reference
from poil_drake.transfer.part_points import (
    PartCloudConfig,
    PartView,
    sample_part_points,
    view_part,
)
from poil_drake.transfer.registration.non_rigid import NonRigidConfig, register_non_rigid

Progress = Callable[[str, float], None]
"""Called with what is being done and the fraction of it that is done."""


@dataclass(frozen=True, kw_only=True)
class TransferConfig:
    """How a demonstration is carried over.

    Attributes:
        num_points: N_k, how many points stand for the part (POIL: 10).
        clouds: How clouds are made.
        alignment: The coarse alignment.
        non_rigid: The deformation that follows.
        ambiguity: Which matchings are alternatives.
        reference: How tracked points become a reference.
        pose_by_deformed_points: Whether the deformed points are what is aligned with the tracks, as
            in the paper. By default the coarsely aligned points are, and the deformed ones carried
            along: the deformation fits the part alone, and turns it towards the side that is seen.
        max_tracking_gap: For how long the tracker may lose the object in the demonstration [s].
    """

    num_points: int = 10
    clouds: PartCloudConfig = field(default_factory=PartCloudConfig)
    alignment: CoarseAlignmentConfig = field(default_factory=CoarseAlignmentConfig)
    non_rigid: NonRigidConfig = field(default_factory=NonRigidConfig)
    ambiguity: AmbiguityConfig = field(default_factory=AmbiguityConfig)
    reference: ReferenceConfig = field(default_factory=ReferenceConfig)
    pose_by_deformed_points: bool = False
    max_tracking_gap: float = 1.0

    def __post_init__(self) -> None:
        if self.num_points < 3:
            raise InvalidValueError(
                f"TransferConfig.num_points is {self.num_points}.",
                remedy="At least 3 points determine a pose; POIL uses 10.",
            )


@dataclass(frozen=True, eq=False)
class TransferResult(SharedOnCopy):
    """What a transfer found.

    Attributes:
        matchings: The ways in which the parts match, likeliest first; at least one.
        demonstrated_points: (N, 3) the points on the demonstrated part, in its first frame
            [m, world].
        tracks: Their motion in the demonstration.
        part_cloud: The target's part [m, world].
        object_cloud: The whole target object [m, world].
        target_stamp: When the target was seen [s].
    """

    matchings: tuple[Matching, ...]
    demonstrated_points: np.ndarray
    tracks: DemonstrationTracks
    part_cloud: PointCloud
    object_cloud: PointCloud
    target_stamp: float

    def __post_init__(self) -> None:
        points = frozen_array(
            self.demonstrated_points, name="TransferResult.demonstrated_points", shape=("N", 3)
        )
        object.__setattr__(self, "demonstrated_points", points)


def transfer(
    demonstration: Demonstration,
    target_frame: MultiViewFrame,
    *,
    detector: PartDetector,
    tracker: PointTracker,
    object_label: str,
    part_label: str,
    demonstration_object_label: str | None = None,
    config: TransferConfig | None = None,
    progress: Progress | None = None,
) -> TransferResult:
    """Carries a demonstrated motion over to another object with the same functional part.

    The part is found in both scenes; points are spread over the demonstrated one; coarse alignment
    and non-rigid registration tell where they lie on the target's; they are followed through the
    demonstration; and at each of its times the target's points are rigidly aligned with them.

    Args:
        demonstration: The demonstration. Its first frame must let the detector find the part.
        target_frame: The scene with the target object.
        detector: Finds object and part in both.
        tracker: Follows the demonstrated points.
        object_label: What the target object is called.
        part_label: What the functional part of both objects is called.
        demonstration_object_label: What the demonstrated object is called, if otherwise.
        config: Parameters, None for the defaults.
        progress: Told what is being done and which share of it, in [0, 1].

    Raises:
        DetectionError: if an object or a part is not found.
        TrackingError: if the tracker loses the object in the demonstration.
        TransferError: if the parts cannot be aligned, or nothing moves in the demonstration.
    """
    config = config or TransferConfig()
    first_frame = demonstration.frames[0]
    source, target = (
        _view(frame, where, detector, label, part_label, config)
        for frame, where, label in (
            (
                first_frame,
                f"the first frame of the demonstration '{demonstration.name}'",
                demonstration_object_label or object_label,
            ),
            (target_frame, "the view of the scene", object_label),
        )
    )
    points = sample_part_points(source.part, config.num_points)
    alignments = symmetric_alignments(
        source.part,
        target.part,
        source_context=source.context,
        target_context=target.context,
        alignment=config.alignment,
        ambiguity=config.ambiguity,
        progress=progress,
    )
    tracks = track_demonstration(
        demonstration.frames,
        points,
        source.masks.object_masks,
        tracker=tracker,
        max_gap=config.max_tracking_gap,
        progress=progress,
    )
    return TransferResult(
        matchings=tuple(
            _matching(a, source, target, points, tracks, config, progress) for a in alignments
        ),
        demonstrated_points=points,
        tracks=tracks,
        part_cloud=target.part,
        object_cloud=target.whole,
        target_stamp=target_frame.stamp,
    )


def _view(
    frame: MultiViewFrame,
    where: str,
    detector: PartDetector,
    object_label: str,
    part_label: str,
    config: TransferConfig,
) -> PartView:
    """Returns the part in a frame; an error says `where` it was not found."""
    try:
        return view_part(
            frame,
            detector=detector,
            object_label=object_label,
            part_label=part_label,
            config=config.clouds,
        )
    except DetectionError as error:
        raise DetectionError(f"In {where}: {error.problem}", remedy=error.remedy) from error


def _matching(
    alignment: CoarseAlignment,
    source: PartView,
    target: PartView,
    points: np.ndarray,
    tracks: DemonstrationTracks,
    config: TransferConfig,
    progress: Progress | None,
) -> Matching:
    part, placed = alignment.apply(source.part.points), alignment.apply(points)
    field_ = register_non_rigid(
        part, target.part.points, carried=placed, config=config.non_rigid, progress=progress
    )
    target_points = field_.apply(placed)
    distances, _ = cKDTree(field_.apply(part)).query(target.part.points)
    return Matching(
        target_points=target_points,
        reference=make_matching_reference(
            target_points,
            tracks,
            posed_by=None if config.pose_by_deformed_points else placed,
            config=config.reference,
        ),
        chamfer=float(distances.mean()),
        cost=alignment.cost,
        rotation=alignment.rotation,
        scales=alignment.scales,
    )
