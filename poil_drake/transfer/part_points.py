"""Views of a part and its object, and the points that represent the part."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import DetectionError, TransferError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.point_cloud import PointCloud, farthest_point_sampling
from poil_drake.perception.detectors import Detector, PartMasks
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import MultiViewFrame

_PART_FUSION = FusionConfig(voxel_size=0.002)  # Fine enough for the shape of a small handle.
_OBJECT_FUSION = FusionConfig(voxel_size=0.004)  # The object has ten times the surface.
_MIN_CONTEXT_POINTS = 100  # With fewer points, the rest of the object counts as unseen.


@dataclass(frozen=True, eq=False)
class PartView(SharedOnCopy):
    """A functional part and its object at one instant.

    Attributes:
        masks: Masks of the part and the object in the images.
        part: The part's cloud [m, world].
        whole: The whole object's cloud [m, world].
        context: The cloud of the object without the part [m, world]; None if too little is seen.
    """

    masks: PartMasks
    part: PointCloud
    whole: PointCloud
    context: PointCloud | None


def view_part(
    frame: MultiViewFrame, *, detector: Detector, object_label: str, part_label: str
) -> PartView:
    """Detects a part and its object in one frame, and fuses all views of each into a cloud.

    Before the fusion, masks are eroded and pixels near depth edges are dropped.

    Args:
        frame: The frame.
        detector: Finds the object and the part.
        object_label: The object's label.
        part_label: The part's label.

    Raises:
        DetectionError: if the object or the part is not found, or has no reliable depth.
    """
    masks = detector.detect(frame, object_label=object_label, part_label=part_label)
    rest = tuple(o & ~p for o, p in zip(masks.object_masks, masks.part_masks, strict=True))
    part = fuse_views(frame, masks.part_masks, _PART_FUSION)
    whole = fuse_views(frame, masks.object_masks, _OBJECT_FUSION)
    try:
        context = fuse_views(frame, rest, _OBJECT_FUSION)
    except DetectionError:  # The part is the whole object.
        return PartView(masks, part, whole, None)
    return PartView(masks, part, whole, context if len(context) >= _MIN_CONTEXT_POINTS else None)


def sample_part_points(part: PointCloud, count: int) -> np.ndarray:
    """Returns points (count, 3) [m] spread over the part by farthest-point sampling.

    Raises:
        TransferError: if the part has fewer than `count` points.
    """
    if len(part) < count:
        raise TransferError(
            f"The part's cloud has {len(part)} points; {count} are needed to represent the part.",
            remedy="Move a camera nearer to the part, or lower poil.num_points.",
        )
    return part.points[farthest_point_sampling(part.points, count)]
