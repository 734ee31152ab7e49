"""A tracker that returns the motion predicted by forward kinematics, and can fail on request."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput


@dataclass(frozen=True)
class PriorState:
    """State of the tracker.

    Attributes:
        points: (N, 3) positions [m].
        carried: Number of steps in which the object moved.
    """

    points: np.ndarray
    carried: int = 0


@dataclass(frozen=True, kw_only=True)
class PriorTracker:
    """Moves the points along with the held object.

    Attributes:
        stall: Duration of one step while the object is carried [s, not scaled].
        kill_marker: If not empty, the process is killed once the object is carried, and leaves
            this file.
        restarts: Whether a new process works; otherwise it is killed as soon as it starts to track.
    """

    stall: float = 0.0
    kill_marker: str = ""
    restarts: bool = True

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        if self._was_killed and not self.restarts:
            os.kill(os.getpid(), signal.SIGKILL)
        return self._output(PriorState(query_points), frame)

    def step(
        self, state: PriorState, frame: MultiViewFrame, motion_prior: np.ndarray | None = None
    ) -> TrackerOutput:
        X_M = np.eye(4) if motion_prior is None else motion_prior
        moves = not np.allclose(X_M, np.eye(4), atol=1e-5)
        carried = state.carried + moves
        if self.kill_marker and carried > 1 and not self._was_killed:
            Path(self.kill_marker).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if self.stall and moves and carried == 3:
            time.sleep(self.stall)
        points = transform_points(X_M, state.points)
        return self._output(PriorState(points, carried), frame)

    @property
    def _was_killed(self) -> bool:
        return bool(self.kill_marker) and Path(self.kill_marker).exists()

    def _output(self, state: PriorState, frame: MultiViewFrame) -> TrackerOutput:
        confidence = np.ones(len(state.points))
        points = TrackedPoints(positions=state.points, confidence=confidence, stamp=frame.stamp)
        return TrackerOutput(state, points, False)
