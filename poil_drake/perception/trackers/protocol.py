"""The protocol of point trackers."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints


@dataclass(frozen=True, eq=False)
class TrackerOutput(SharedOnCopy):
    """What a tracker returns for one frame.

    Attributes:
        state: The state to pass to the next step; immutable, of a type that the tracker chooses.
        points: The tracked points.
        lost: Whether the tracker has lost the object. All points then have confidence 0.
    """

    state: Any
    points: TrackedPoints
    lost: bool


class Tracker(Protocol):
    """Tracks points on one rigid object through a stream of multi-view RGB-D frames.

    The methods are pure: the returned state holds all knowledge of the stream. One tracker can
    therefore serve many streams, and the state of a stream can be part of a Drake Context.
    """

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        """Starts tracking.

        Args:
            frame: The first frame.
            query_points: (N, 3) points on the object at the time of that frame [m, world].
            object_masks: V masks (H, W) bool, which show the object in each view of that frame.

        Raises:
            TrackingError: if the views show too little of the object.
        """

    def step(
        self,
        state: Any,
        frame: MultiViewFrame,
        motion_prior: np.ndarray | None = None,
    ) -> TrackerOutput:
        """Tracks the points to the next frame.

        Args:
            state: The `state` of the previous output.
            frame: The new frame.
            motion_prior: (4, 4) expected motion of the object in the world since the previous
                frame, X_WO(t) X_WO(t_prev)^-1, e.g. from the forward kinematics of the hand that
                holds the object. If None, the tracker extrapolates the object's velocity.
        """
