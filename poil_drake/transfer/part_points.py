"""Views of a part and its object, and the points that represent the part."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import DetectionError, TransferError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.point_cloud import PointCloud, farthest_point_sampling
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import MultiViewFrame

_SMALLEST, _LARGEST = 0.5, 1.9  # Size of a target, relative to the demonstrated object.
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
    frame: MultiViewFrame, masks: PartMasks, fusion: FusionConfig | None = None
) -> PartView:
    """Fuses all views of a part, and of its object, into a cloud.

    Before the fusion, masks are eroded and pixels near depth edges are dropped.

    Args:
        frame: The frame.
        masks: Where the frame shows the object and its part.
        fusion: How the part's cloud is made; the object's is coarser. None for the defaults.

    Raises:
        DetectionError: if the object or the part has no reliable depth.
    """
    fusion = fusion or FusionConfig()
    rest = tuple(o & ~p for o, p in zip(masks.object_masks, masks.part_masks, strict=True))
    part = fuse_views(frame, masks.part_masks, fusion)
    whole = fuse_views(frame, masks.object_masks, fusion.coarser())
    try:
        context = fuse_views(frame, rest, fusion.coarser())
    except DetectionError:  # The part is the whole object.
        return PartView(masks, part, whole, None)
    return PartView(masks, part, whole, context if len(context) >= _MIN_CONTEXT_POINTS else None)


def require_similar_size(source: PartView, target: PartView) -> None:
    """Checks that the target is about as large as the demonstrated object.

    Sizes are root mean square distances from the centroid of what the cameras see.

    Args:
        source: The demonstrated object.
        target: The target.

    Raises:
        TransferError: if the target is less than half or almost twice as large, where alignments
            are usually wrong.
    """
    sizes = [float(np.sqrt(view.whole.points.var(axis=0).sum())) for view in (source, target)]
    ratio = sizes[1] / sizes[0]
    if not _SMALLEST <= ratio <= _LARGEST:
        raise TransferError(
            f"The target object looks {ratio:.3g} times as large as the demonstrated one; the "
            f"motion can be transferred to {_SMALLEST} to {_LARGEST} times its size.",
            remedy="Demonstrate with an object of about the target's size (poil.demonstration or "
            "poil.demonstration_object), and check that the detector's masks show just the object.",
        )


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
