"""Advances a tracker by one frame: decides whether it waits, starts, steps or restarts."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import Tracker
from poil_drake.systems.statuses import TrackerStatus


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackerInputs(SharedOnCopy):
    """The tracker's inputs at one capture.

    Attributes:
        frame: The images.
        masks: The latest detection; None before the first.
        query_points: (N, 3) the points at the time of the first start [m, world]; None or NaN until
            known.
        object_motion: (4, 4) X_M, the object's motion in the world since a fixed time, from forward
            kinematics; None if unknown.
    """

    frame: MultiViewFrame
    masks: PartMasks | None
    query_points: np.ndarray | None
    object_motion: np.ndarray | None


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackerRun(SharedOnCopy):
    """The state of tracking after a capture.

    Attributes:
        points: The points to report.
        status: Whether the tracker follows the object.
        tracker_state: The tracker's own state; None before the first start.
        state_motion: (4, 4) `object_motion` at the frame of `tracker_state`; None if unknown.
        masks: The detection at the last attempt to start; None before the first attempt.
        query_points: (N, 3) the query points at the last attempt to start [m, world]; None before
            the first attempt.
        query_motion: (4, 4) `object_motion` at the first attempt with these query points; None if
            unknown.
    """

    points: TrackedPoints
    status: TrackerStatus = TrackerStatus.WAITING
    tracker_state: Any = None
    state_motion: np.ndarray | None = None
    masks: PartMasks | None = None
    query_points: np.ndarray | None = None
    query_motion: np.ndarray | None = None


def advance(tracker: Tracker, run: TrackerRun, inputs: TrackerInputs) -> TrackerRun:
    """Returns the state of tracking after one more frame, given the state `run` before it.

    Unless the status is TRACKING, the tracker starts once query points and a new detection are
    known. Its first start uses the query points as they are. A restart moves the points by the
    object's motion since their first use, which is correct while the grasp is rigid. In all other
    frames, a tracker that has started steps, even while the object is lost. The prior of a step is
    the object's motion since the last frame in which `start` or `step` raised no error.
    """
    query, masks = inputs.query_points, inputs.masks
    lost = TrackedPoints.lost(len(run.points.positions), inputs.frame.stamp)
    try:
        if (
            run.status is not TrackerStatus.TRACKING
            and (masks is not None and masks is not run.masks)
            and (query is not None and np.all(np.isfinite(query)))
        ):
            if run.query_points is None or not np.array_equal(query, run.query_points):
                run = replace(run, query_points=query, query_motion=inputs.object_motion)
            run = replace(run, masks=masks)
            since = _motion_between(run.query_motion, inputs.object_motion)
            points_now = query if since is None else transform_points(since, query)
            output = tracker.start(inputs.frame, points_now, masks.object_masks)
        elif run.tracker_state is not None:
            prior = _motion_between(run.state_motion, inputs.object_motion)
            output = tracker.step(run.tracker_state, inputs.frame, prior)
        else:
            return replace(run, points=lost)
    except TrackingError:
        # The tracker's state and the motion stay those of the last usable frame.
        return replace(run, points=lost, status=TrackerStatus.LOST)
    return replace(
        run,
        points=output.points,
        status=TrackerStatus.LOST if output.lost else TrackerStatus.TRACKING,
        tracker_state=output.state,
        state_motion=inputs.object_motion,
    )


def _motion_between(before: np.ndarray | None, now: np.ndarray | None) -> np.ndarray | None:
    """Returns X_M(now) X_M(before)^-1 (4, 4); None if either motion is unknown."""
    return None if before is None or now is None else now @ inverse(before)
