"""Finds the object, its functional part and the fixture in a demonstration, without labels."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from poil_drake.errors import DetectionError, TrackingError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.point_cloud import (
    PointCloud,
    farthest_point_sampling,
    statistical_inliers,
    voxel_downsample,
)
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.detectors.known_shape.contact_region import contact_region
from poil_drake.perception.detectors.known_shape.detector import SHAPE_FUSION
from poil_drake.perception.detectors.known_shape.moved_object import (
    Masks,
    arrived_masks,
    departed_masks,
    world_points,
)
from poil_drake.perception.detectors.known_shape.object_clusters import object_clusters
from poil_drake.perception.detectors.known_shape.shape_fit import KnownShape
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.fusion import fuse_views
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.transfer.demonstration_tracks import DemonstrationTracks, track_demonstration
from poil_drake.transfer.progress import Progress

_SUPPORT_POINTS = 40  # tracked on the object, as in the paper
_NEAR_FIXTURE = 0.04  # at the end, the object is at most this far from the fixture [m]
_PIXEL_REACH = 0.006  # of a pixel from the shape [m]
_THIN_FOOT = 0.01  # root of the summed squares across it, up to which a foot is a line [m]
_FOOT_HEIGHT = 0.012  # above the table, up to which points surround the foot [m]


@dataclass(frozen=True, eq=False)
class DemonstratedObject(SharedOnCopy):
    """What a demonstration shows of its object.

    Attributes:
        masks: Masks of the object and its part in the first frame.
        tracks: Tracks of points on the object.
        shape: The object's shape, from the first and the last frame, where it is in the first
            frame [m, world], and its functional part.
        fixture: (F, 3) points of the fixture [m, world].
    """

    masks: PartMasks
    tracks: DemonstrationTracks
    shape: KnownShape
    fixture: np.ndarray


def find_demonstrated_object(
    demonstration: Demonstration,
    *,
    table_height: float,
    tracker: Tracker,
    progress: Progress | None = None,
) -> DemonstratedObject:
    """Finds the object, its part and the fixture by what happens in the demonstration.

    The object is what stood on the table in the first frame and has left that place in the last.
    It is tracked. The fixture is what stands still next to where the object ends, and the part is
    the piece of the object that is next to the fixture then.

    Args:
        demonstration: The demonstration. The hand is in neither its first nor its last frame, or
            apart from the object there.
        table_height: Height of the plane on which objects stand [m, world].
        tracker: Tracks the object.
        progress: Called with the current activity and its completed fraction.

    Raises:
        DetectionError: if nothing, or more than one thing, moved, or if the object ends next to
            nothing.
        TrackingError: if the tracker loses the object.
    """
    first, last = demonstration.frames[0], demonstration.frames[-1]
    moved = departed_masks(first, last, table_height=table_height)
    found: list[tuple[Masks, DemonstrationTracks]] = []
    failure: TrackingError | None = None
    for masks in moved:
        try:
            points = fuse_views(first, masks).points
            support = points[farthest_point_sampling(points, min(_SUPPORT_POINTS, len(points)))]
            tracks = track_demonstration(
                demonstration, support, masks, tracker=tracker, progress=progress
            )
        except DetectionError:  # Only edges: noise.
            continue
        except TrackingError as error:  # A hand, for example, that has left.
            failure = error
            continue
        found.append((masks, tracks))
    if failure is not None and not found:
        raise failure
    if len(found) != 1:
        raise DetectionError(
            f"{len(found) or 'No'} objects left their places between the first and the last frame "
            f"of the demonstration '{demonstration.name}'; exactly one must.",
            remedy="Record again: start and end with the object at rest and no hand in view, and "
            "move nothing else; or name the object with another poil.detector.",
        )
    masks, tracks = found[0]
    motion = kabsch(tracks.positions[0], tracks.positions[-1], tracks.confidence[-1])
    seen = fuse_views(first, masks, SHAPE_FUSION)
    end = arrived_masks(
        first, last, transform_points(motion, seen.points), table_height=table_height
    )
    try:
        cloud = _joined(seen, fuse_views(last, end, SHAPE_FUSION), inverse(motion))
    except DetectionError:  # The last frame hides the object.
        cloud = seen
    at_end = transform_points(motion, cloud.points)
    fixture, distances = _fixture(demonstration, masks, at_end, table_height)
    part = contact_region(cloud.points, distances)
    tree = cKDTree(cloud.points)
    part_masks = []
    for camera, image, mask in zip(first.cameras, first.images, masks, strict=True):
        distance, nearest = tree.query(world_points(camera, image.depth)[mask])
        own = np.zeros(mask.shape, dtype=bool)
        own[mask] = (distance < _PIXEL_REACH) & part[nearest]
        part_masks.append(own)
    foot = _foot(cloud, table_height)
    shape = KnownShape(
        PointCloud(
            np.concatenate([cloud.points, foot]),
            np.concatenate([_normals(cloud), np.tile([0.0, 0.0, -1.0], (len(foot), 1))]),
        ),
        np.concatenate([part, np.zeros(len(foot), dtype=bool)]),
        np.arange(len(cloud) + len(foot)) >= len(cloud),
    )
    return DemonstratedObject(PartMasks(masks, tuple(part_masks)), tracks, shape, fixture)


def _foot(cloud: PointCloud, table_height: float) -> np.ndarray:
    """Returns points (F, 3) of the side on which the object stood, which no camera saw [m, world].

    It is the convex hull of the object's lowest points, on the table. Without it, an object that
    lies would look unlike the demonstrated one.
    """
    low = cloud.points[cloud.points[:, 2] < table_height + _FOOT_HEIGHT, :2]
    if len(low) < 4 or np.linalg.matrix_rank(low - low.mean(axis=0), tol=_THIN_FOOT) < 2:
        return np.zeros((0, 3))
    steps = [np.arange(x.min(), x.max(), SHAPE_FUSION.voxel_size) for x in low.T]
    grid = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    grid = grid[Delaunay(low).find_simplex(grid) >= 0]
    return np.column_stack([grid, np.full(len(grid), table_height)])


def _normals(cloud: PointCloud) -> np.ndarray:
    assert cloud.normals is not None
    return cloud.normals


def _joined(first: PointCloud, last: PointCloud, back: np.ndarray) -> PointCloud:
    """Returns the object's cloud in the first frame, and that in the last frame moved back."""
    cloud = PointCloud(
        np.concatenate([first.points, transform_points(back, last.points)]),
        np.concatenate([_normals(first), _normals(last) @ back[:3, :3].T]),
    )
    cloud = voxel_downsample(cloud, SHAPE_FUSION.voxel_size)
    return cloud.select(statistical_inliers(cloud.points, neighbours=16, deviations=2.5))


def _fixture(
    demonstration: Demonstration, masks: Masks, at_end: np.ndarray, table_height: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the fixture's points (F, 3), and the object's distances (P,) from it at the end [m].

    The first frame shows all of the fixture, because the object is elsewhere.
    """
    first = demonstration.frames[0]
    best, near = np.zeros((0, 3)), np.full(len(at_end), np.inf)
    for cluster in object_clusters(first, table_height=table_height, background=np.zeros((0, 3))):
        still = tuple(own & ~mask for own, mask in zip(cluster, masks, strict=True))
        if sum(int(mask.sum()) for mask in still) < 0.5 * sum(int(own.sum()) for own in cluster):
            continue
        points = fuse_views(first, still, SHAPE_FUSION).points
        distances = cKDTree(points).query(at_end)[0]
        if distances.min() < near.min():
            best, near = points, distances
    if near.min() > _NEAR_FIXTURE:
        where = f"{100 * near.min():.0f} cm from" if np.isfinite(near.min()) else "without"
        raise DetectionError(
            f"The object of the demonstration '{demonstration.name}' ends {where} anything else "
            "above the table, so its functional part cannot be told.",
            remedy="Check poil.table_height, or name the part with another poil.detector.",
        )
    return best, near
