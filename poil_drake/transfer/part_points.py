"""What cameras show of a part and its object, and the points that stand for the part."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import DetectionError, TransferError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.sampling import farthest_point_sampling
from poil_drake.perception.detectors.protocol import PartDetector, PartMasks
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import MultiViewFrame


@dataclass(frozen=True, kw_only=True)
class PartCloudConfig:
    """How the clouds of part and object are made.

    Attributes:
        part_fusion: For the part. Handles are small: 2 mm voxels keep their shape.
        object_fusion: For the object; coarser, as it has ten times the surface.
        min_context_points: With fewer points the rest of the object counts as not seen.
    """

    part_fusion: FusionConfig = field(default_factory=FusionConfig)
    object_fusion: FusionConfig = field(default_factory=lambda: FusionConfig(voxel_size=0.004))
    min_context_points: int = 100


@dataclass(frozen=True, eq=False)
class PartView(SharedOnCopy):
    """A functional part and its object at one instant.

    Attributes:
        masks: Where they are in the images.
        part: The part's cloud [m, world].
        whole: The whole object's cloud [m, world].
        context: The cloud of the object without the part; None where too little of it is seen.
    """

    masks: PartMasks
    part: PointCloud
    whole: PointCloud
    context: PointCloud | None


def view_part(
    frame: MultiViewFrame,
    *,
    detector: PartDetector,
    object_label: str,
    part_label: str,
    config: PartCloudConfig | None = None,
) -> PartView:
    """Detects the part in one frame and fuses what all views show of it.

    Masks are eroded and pixels near depth edges dropped before the views are unprojected.

    Raises:
        DetectionError: if the object or the part is not found, or has no depth to trust.
    """
    config = config or PartCloudConfig()
    masks = detector.detect(frame, object_label=object_label, part_label=part_label)
    rest = tuple(o & ~p for o, p in zip(masks.object_masks, masks.part_masks, strict=True))
    part = fuse_views(frame, masks.part_masks, config.part_fusion)
    whole = fuse_views(frame, masks.object_masks, config.object_fusion)
    try:
        context = fuse_views(frame, rest, config.object_fusion)
    except DetectionError:  # The object is nothing but its part.
        return PartView(masks, part, whole, None)
    enough = len(context) >= config.min_context_points
    return PartView(masks, part, whole, context if enough else None)


def sample_part_points(part: PointCloud, count: int) -> np.ndarray:
    """Returns (count, 3) points [m] that spread over the part by farthest-point sampling.

    Raises:
        TransferError: if the part has fewer points than that.
    """
    if len(part) < count:
        raise TransferError(
            f"The part is seen with {len(part)} points, but {count} shall stand for it.",
            remedy="Bring a camera nearer, lower the voxel size, or ask for fewer points.",
        )
    return part.points[farthest_point_sampling(part.points, count)]
