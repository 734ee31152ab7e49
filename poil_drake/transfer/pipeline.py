"""Transfers a demonstration to the object in a view of the target scene (POIL section III-A)."""

from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.fusion import FusionConfig
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.transfer.alignment.coarse_alignment import symmetric_alignments
from poil_drake.transfer.alignment.problem import AlignmentProblem, CoarseAlignmentConfig
from poil_drake.transfer.demonstration_tracks import DemonstrationTracks, track_demonstration
from poil_drake.transfer.matching import Matching, make_matching_reference
from poil_drake.transfer.non_rigid_registration import deform_points
from poil_drake.transfer.part_points import (
    require_similar_size,
    sample_part_points,
    view_part,
)
from poil_drake.transfer.progress import Progress


@dataclass(frozen=True, kw_only=True)
class TransferConfig:
    """How a demonstration is transferred.

    Attributes:
        num_points: N_k, the number of points that represent the part (POIL: 10).
        fusion: How images become the part's cloud.
        alignment: Parameters of the coarse alignment.
        pose_by_deformed_points: Whether to align the points after the non-rigid registration with
            the tracks, as the paper does. By default the coarsely aligned points are aligned, and
            the registered ones move along rigidly. Registration turns parts to their visible side.
    """

    num_points: int = 10
    fusion: FusionConfig = field(default_factory=FusionConfig)
    alignment: CoarseAlignmentConfig = field(default_factory=CoarseAlignmentConfig)
    pose_by_deformed_points: bool = False

    def __post_init__(self) -> None:
        if self.num_points < 3:
            raise InvalidValueError(
                f"TransferConfig.num_points is {self.num_points}, but a pose needs three points.",
                remedy="Use at least 3 points; POIL uses 10.",
            )


@dataclass(frozen=True, eq=False)
class TransferResult:
    """The result of a transfer.

    Attributes:
        matchings: The ways in which the parts match, likeliest first; at least one.
        part_cloud: The target's part [m, world].
        object_cloud: The whole target object [m, world].
    """

    matchings: tuple[Matching, ...]
    part_cloud: PointCloud
    object_cloud: PointCloud


def transfer(
    demonstration: Demonstration,
    target_frame: MultiViewFrame,
    *,
    source_masks: PartMasks,
    target_masks: PartMasks,
    tracker: Tracker,
    tracks: DemonstrationTracks | None = None,
    config: TransferConfig | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> TransferResult:
    """Transfers a demonstrated motion to another object with the same functional part.

    Points are sampled on the demonstrated part. Coarse alignment and non-rigid registration map
    these points to the target's part. The tracker follows the points through the demonstration, and
    in each of its frames the target's points are rigidly aligned with the tracked points.

    Args:
        demonstration: The demonstration.
        target_frame: The scene with the target object.
        source_masks: The object and its part in the demonstration's first frame.
        target_masks: The object and its part in `target_frame`.
        tracker: Tracks the demonstrated points.
        tracks: Tracks of any points of the demonstrated object; None to track those of the part.
        config: Parameters; None for the defaults.
        executor: Deforms the part while the tracker works; None for a thread.
        progress: Called with the current activity and its completed fraction.

    Raises:
        DetectionError: if an object or a part has no reliable depth.
        TrackingError: if the tracker loses the object in the demonstration.
        TransferError: if the parts cannot be aligned, the target is much larger or smaller than the
            demonstrated object, or nothing moves in the demonstration.
    """
    config = config or TransferConfig()

    source = view_part(demonstration.frames[0], source_masks, config.fusion)
    target = view_part(target_frame, target_masks, config.fusion)
    require_similar_size(source, target)
    points = sample_part_points(source.part, config.num_points)
    problem = AlignmentProblem.between(
        source.part,
        target.part,
        source_context=source.context,
        target_context=target.context,
        config=config.alignment,
    )
    alignments = symmetric_alignments(problem, target.part.points, progress=progress)
    placed = [alignment.apply(points) for alignment in alignments]
    with nullcontext(executor) if executor else ThreadPoolExecutor(max_workers=1) as pool:
        deformed = [
            pool.submit(deform_points, alignment.apply(source.part.points), target.part.points, own)
            for alignment, own in zip(alignments, placed, strict=True)
        ]
        if tracks is not None:
            part_tracks = tracks.carried(points)
        else:
            part_tracks = track_demonstration(
                demonstration,
                points,
                source_masks.object_masks,
                tracker=tracker,
                progress=progress,
            )
    matchings = []
    for alignment, own, future in zip(alignments, placed, deformed, strict=True):
        target_points = future.result()
        posed_by = None if config.pose_by_deformed_points else own
        reference = make_matching_reference(target_points, part_tracks, posed_by=posed_by)
        matchings.append(Matching(target_points, reference, alignment.cost))
    return TransferResult(tuple(matchings), target.part, target.whole)
