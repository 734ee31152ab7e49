"""The base of trackers that match single points: a rigid motion is fitted to what they match."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.errors import DetectionError, InvalidValueError, TrackingError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.geometry.point_cloud import farthest_point_sampling
from poil_drake.geometry.rigid_fit import kabsch, rigid_inliers
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.fusion import fuse_views
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput

_INLIER_DISTANCE = 0.01
"""Largest distance of a match from where the object's motion puts the point [m]; more than the
noise of a depth camera, less than the distance to what occludes the object."""

_MIN_POINTS = 6  # different points that must be matched; 3 determine a pose, but do not confirm it
_MIN_AGREEMENT = 0.5  # share of the matches that must move together
_HIDDEN = 0.5  # confidence in a point without a match, as a share of that in a matched one


class Sighting(NamedTuple):
    """A frame in which the object was tracked, and its motion (4, 4) since the start, in world."""

    frame: MultiViewFrame
    motion: np.ndarray


class Matches(NamedTuple):
    """K observations of points; a point may have several, e.g. one from each view.

    Attributes:
        ids: (K,) which points were observed.
        positions: (K, 3) where [m, world]; observations that are not finite are ignored.
        weights: (K,) how certain they are, above 0.
    """

    ids: np.ndarray
    positions: np.ndarray
    weights: np.ndarray

    @classmethod
    def joined(cls, parts: "Sequence[Matches]") -> "Matches":
        """Returns the finite observations of several sets, of which there may be none."""
        none = cls(np.empty(0, dtype=int), np.empty((0, 3)), np.empty(0))
        ids, positions, weights = map(np.concatenate, zip(none, *parts, strict=True))
        finite = np.isfinite(positions).all(axis=1)
        return cls(ids[finite], positions[finite], weights[finite])


@dataclass(frozen=True, eq=False)
class RigidPointsState(SharedOnCopy):
    """What a tracker of single points knows after a frame.

    Attributes:
        points: (M, 3) the matched points at the start [m, world]: the points to report, then
            support points.
        num_reported: Number of points to report.
        start: The first frame.
        recent: The latest frames in which the object was tracked, the oldest first.
        predicted: (4, 4) the object's motion since the start, as far as known: a lost object is
            assumed to follow the motion prior.
    """

    points: np.ndarray
    num_reported: int
    start: Sighting
    recent: tuple[Sighting, ...]
    predicted: np.ndarray


class RigidPointsTracker(ABC):
    """Tracks points on one rigid object, by matches of these and of support points; a `Tracker`.

    The object's motion since the start is fitted to all matches, without the outliers. So points
    that no view shows are reported, too, but with less confidence. The object is lost if few points
    are matched, or if their matches contradict each other.
    """

    def __init__(self, *, support_points: int, memory: int):
        """Constructs the tracker.

        Args:
            support_points: Number of support points, spread over the object's visible surface.
            memory: Number of frames, besides the first, that the state keeps.
        """
        self._support_points, self._memory = support_points, memory

    @abstractmethod
    def _match(
        self, state: RigidPointsState, frame: MultiViewFrame, predicted: np.ndarray
    ) -> Matches:
        """Returns where a new frame shows `state.points`.

        Args:
            state: The state after the last frame.
            frame: The new frame.
            predicted: (4, 4) predicted motion of the object since the start.
        """

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        """Starts tracking; see `Tracker.start`.

        Raises:
            InvalidValueError: if masks and images differ in number or size, or if query points are
                not finite.
            TrackingError: if the views show too little of the object.
        """
        points = frozen_array(query_points, name="query_points", shape=("N", 3))
        support = _sample_support(frame, object_masks, self._support_points)
        still = frozen_array(np.eye(4), name="motion", shape=(4, 4))
        state = RigidPointsState(
            points=np.vstack([points, support]),
            num_reported=len(points),
            start=Sighting(frame, still),
            recent=(),
            predicted=still,
        )
        return TrackerOutput(state, TrackedPoints(points, np.ones(len(points)), frame.stamp), False)

    def step(
        self,
        state: RigidPointsState,
        frame: MultiViewFrame,
        motion_prior: np.ndarray | None = None,
    ) -> TrackerOutput:
        """Tracks the points to the next frame; see `Tracker.step`."""
        predicted = state.predicted
        if motion_prior is not None:
            prior = frozen_array(motion_prior, name="motion_prior", shape=(4, 4))
            predicted = prior @ predicted
        matches = self._match(state, frame, predicted)
        count, recent, lost = state.num_reported, state.recent, False
        found = _fit(state.points, matches)
        if found is None:
            points, lost = TrackedPoints.lost(count, frame.stamp), True
        else:
            predicted, inliers = found
            recent = (*recent, Sighting(frame, predicted))[-self._memory :]
            positions = transform_points(predicted, state.points[:count])
            matched = np.isin(np.arange(count), matches.ids[inliers])
            confidence = inliers.mean() * np.where(matched, 1.0, _HIDDEN)
            points = TrackedPoints(positions, confidence, frame.stamp)
        new_state = RigidPointsState(state.points, count, state.start, recent, predicted)
        return TrackerOutput(new_state, points, lost)


def _fit(points: np.ndarray, matches: Matches) -> tuple[np.ndarray, np.ndarray] | None:
    """Returns the motion (4, 4) of points (M, 3), and which matches (K,) agree with it.

    Returns None if there are too few matches, or if they contradict each other.
    """
    if len(np.unique(matches.ids)) < _MIN_POINTS:
        return None
    source, target = points[matches.ids], matches.positions
    inliers = rigid_inliers(source, target, matches.weights, _INLIER_DISTANCE)
    enough = len(np.unique(matches.ids[inliers])) >= _MIN_POINTS
    if not enough or inliers.mean() < _MIN_AGREEMENT:
        return None
    return kabsch(source, target, matches.weights * inliers), inliers


def _sample_support(frame: MultiViewFrame, masks: tuple[np.ndarray, ...], count: int) -> np.ndarray:
    """Returns support points (count, 3) [m, world], spread over the surface that the views show."""
    shapes = [image.depth.shape for image in frame.images]
    given = [np.shape(mask) for mask in masks]
    if given != shapes:
        raise InvalidValueError(
            f"object_masks have shapes {given}, but the frame's images have {shapes}.",
            remedy="Pass one mask (H, W) for each view, all False if it does not show the object.",
        )
    try:
        surface = fuse_views(frame, masks).points
    except DetectionError as error:
        raise TrackingError(error.problem, remedy=error.remedy) from error
    if len(surface) < count:
        raise TrackingError(
            f"The views show only {len(surface)} surface points of the object, but {count} support "
            "points are needed.",
            remedy="Check the masks and the depth images, or move a camera nearer.",
        )
    return surface[farthest_point_sampling(surface, count)]
