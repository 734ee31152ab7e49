"""Tracks the part's points through a demonstration."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.geometry.rigid_fit import kabsch, rigid_inliers
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.transfer.progress import Progress

_MIN_POINTS = 3  # Fewer points do not determine a pose.
_MAX_GAP = 1.0  # Longest time for which the tracker may lose the object [s].

_MAX_INTERVAL = 0.25  # From one tracked frame to the next [s].
_MAX_STEP = 0.04
"""How far a point may move from one tracked frame to the next, at its last speed [m]. A tracker
follows such a step as well as two half as long, in less time."""

_DOUBTFUL = 0.6
"""Median confidence of a frame's points below which no frame is skipped. It rarely falls as low
where tracking is easy, and often where skipped frames would mislead the tracker."""

_INLIER_DISTANCE = 0.01
"""Largest distance of a point from where the object's motion since the first frame puts it [m].
Farther points have drifted, or were confused with others."""


@dataclass(frozen=True, eq=False)
class DemonstrationTracks:
    """Tracks of the part's points over a demonstration.

    Attributes:
        times: (T,) capture times of the tracked frames since the first [s].
        positions: (T, N, 3) [m, world]; NaN where a point was not observed, or did not move with
            the others.
        confidence: (T, N) the tracker's confidence in each point, in [0, 1]; 0 where NaN.
    """

    times: np.ndarray
    positions: np.ndarray
    confidence: np.ndarray

    def carried(self, points: np.ndarray) -> "DemonstrationTracks":
        """Returns the tracks of other points of the same rigid object.

        Each has the median confidence of the tracked points.

        Args:
            points: (M, 3) the points in the first frame [m, world].
        """
        usable = np.count_nonzero(self.confidence > 0.0, axis=1) >= _MIN_POINTS
        positions = np.full((len(self.times), len(points), 3), np.nan)
        tracked = self.positions[usable]
        first = np.broadcast_to(self.positions[0], tracked.shape)
        motions = kabsch(first, tracked, self.confidence[usable])
        moved = np.broadcast_to(points, (len(motions), *points.shape))
        positions[usable] = transform_points(motions, moved)
        confidence = np.where(usable, np.maximum(np.median(self.confidence, axis=1), 1e-3), 0.0)
        return DemonstrationTracks(
            self.times, positions, np.repeat(confidence[:, None], len(points), axis=1)
        )


def track_demonstration(
    demonstration: Demonstration,
    query_points: np.ndarray,
    object_masks: tuple[np.ndarray, ...],
    *,
    tracker: Tracker,
    progress: Progress | None = None,
) -> DemonstrationTracks:
    """Tracks the part's points from the first frame to the last.

    Args:
        demonstration: The demonstration. While it is slow, some of its frames are skipped, unless
            the tracker then loses or doubts the points.
        query_points: (N, 3) the points in the first frame [m, world].
        object_masks: Each camera's mask (H, W) bool of the object in the first frame.
        tracker: Tracks the points.
        progress: Called with the current activity and its completed fraction.

    Raises:
        TrackingError: if the tracker cannot start, or loses the object for longer than 1 s or in
            the last frame; the message says when.
    """

    def track(*, skip: bool) -> DemonstrationTracks:
        return _track(
            demonstration, query_points, object_masks, tracker=tracker, skip=skip, progress=progress
        )

    try:
        quick = track(skip=True)
    except TrackingError:
        return track(skip=False)
    sure = np.median(quick.confidence, axis=1).min() >= _DOUBTFUL
    return quick if sure else track(skip=False)


def _track(
    demonstration: Demonstration,
    query_points: np.ndarray,
    object_masks: tuple[np.ndarray, ...],
    *,
    tracker: Tracker,
    skip: bool,
    progress: Progress | None,
) -> DemonstrationTracks:
    """Tracks the points in all frames or, to `skip`, in fewer while the object is slow."""
    frames, stamps = demonstration.frames, demonstration.stamps
    output = tracker.start(frames[0], query_points, object_masks)
    samples = [(stamps[0], output.points.positions, output.points.confidence)]
    seen_at, speed = stamps[0], np.inf
    k, last = 0, len(frames) - 1
    while k < last:
        k = _next_frame(stamps, k, speed) if skip else k + 1
        frame = frames[k]
        output = tracker.step(output.state, frame)
        points = output.points
        confidence = _rigid_confidence(samples[0][1], points)
        enough = np.count_nonzero(confidence > 0.0) >= _MIN_POINTS
        if enough and not output.lost:
            seen_at = frame.stamp
        elif frame.stamp - seen_at > _MAX_GAP or k == last:
            raise TrackingError(
                f"The tracker lost the object {seen_at - stamps[0]:.2f} s into the "
                f"demonstration, which lasts {stamps[-1] - stamps[0]:.2f} s.",
                remedy="Move the object more slowly and keep it in view of a camera, or change "
                "poil.tracker.",
            )
        shift = np.linalg.norm(points.positions - samples[-1][1], axis=1)
        shift = shift[np.isfinite(shift) & (confidence > 0.0)]
        speed = shift.max() / (stamps[k] - samples[-1][0]) if enough and shift.size else np.inf
        samples.append((frame.stamp, points.positions, confidence))
        if progress is not None:
            frames_used = "the demonstration" if skip else "every frame of the demonstration"
            progress(f"tracking {frames_used}", k / last)
    times, positions, confidence = (np.array(column) for column in zip(*samples, strict=True))
    positions[confidence <= 0.0] = np.nan
    return DemonstrationTracks(times - times[0], positions, confidence)


def _next_frame(stamps: np.ndarray, k: int, speed: float) -> int:
    """Returns the frame to track after frame k, while points move at most at a speed [m/s]."""
    gap = min(_MAX_INTERVAL, _MAX_STEP / max(speed, 1e-9))
    return max(k + 1, int(np.searchsorted(stamps, stamps[k] + gap, side="right")) - 1)


def _rigid_confidence(first: np.ndarray, points: TrackedPoints) -> np.ndarray:
    """Returns the confidences (N,) of `points`; 0 for points that did not move with the others.

    All confidences are 0 if no more than half of the points moved together.

    Args:
        first: (N, 3) the points in the first frame [m, world].
        points: The points in a later frame.
    """
    confidence = points.confidence.copy()
    seen = np.flatnonzero((confidence > 0.0) & np.isfinite(first).all(axis=1))
    if seen.size > _MIN_POINTS:
        moved = rigid_inliers(
            first[seen], points.positions[seen], confidence[seen], _INLIER_DISTANCE
        )
        confidence[seen[~moved]] = 0.0
        if np.count_nonzero(moved) <= seen.size / 2:
            confidence[:] = 0.0
    return confidence
