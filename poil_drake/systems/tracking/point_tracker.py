"""Tracks the points of the object's part in the camera images."""

from collections.abc import Callable, Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers import protocol
from poil_drake.perception.trackers.process_tracker import ProcessTracker
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.cameras.camera_ports import CameraPorts
from poil_drake.systems.capture_and_release import CaptureAndRelease
from poil_drake.systems.capture_timing import Captured, CaptureTiming, SimulatedDelay
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.tracker_outputs import DeclareTrackerOutputs
from poil_drake.systems.tracking.tracker_run import TrackerInputs, TrackerRun, advance


class PointTracker(LeafSystem):
    """Runs a tracker on captured camera images, and outputs each result at its release.

    .. pydrake_system::

        name: PointTracker
        input_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.rgbd_image
        - <camera>.image_time
        - query_points
        - masks
        - object_motion
        output_ports:
        - tracked_points
        - status
        - frame
        - times

    Inputs:

    - `query_points` (3N,) row-major: the points at the start [m, world], NaN until known. Optional
      if the constructor gets them.
    - `masks`: the detector's `PartMasks`, or any other value until known.
    - `object_motion` (16,), X_M row-major: the object's motion in the world since a fixed time,
      from forward kinematics at the time of the images. Optional; NaN if unknown.

    `tracker_run.advance` decides when the tracker starts, steps and restarts.

    Every output is a function of the state alone:

    - `tracked_points`: `TrackedPoints` with the stamp of their images. Before the first release
      all points are lost, with a stamp of minus infinity. Lost points have confidence 0.
    - `status` (1,): a `TrackerStatus` as of the last release; WAITING until a capture at which
      query points and masks are known.
    - `frame`: the `MultiViewFrame` of the last capture; `ABSENT` before the first.
    - `times` (3,) [s]: the time of the last capture, the time of the last release, and the capture
      time of the last released result; minus infinity until known.

    Images are tracked only if their stamp is newer than that of the last capture, so the stamp of
    `tracked_points` ages when a camera freezes.
    """

    def __init__(
        self,
        *,
        tracker: protocol.Tracker,
        cameras: Sequence[CameraModel],
        num_points: int,
        query_points: np.ndarray | None = None,
        timing: CaptureTiming | None = None,
        min_interval: float = 0.0,
        once: bool = False,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the system.

        Args:
            tracker: The tracker to run. A `ProcessTracker` does not block other Python threads.
            cameras: The cameras' models, in the order of the frames' images.
            num_points: Number of points, N.
            query_points: (N, 3) the points at the start [m, world]; a connected port replaces them.
            timing: When frames are captured and results released; None: `SimulatedDelay()`.
            min_interval: Minimum time [s] between the stamps of two captures, for cameras that are
                faster than the tracker.
            once: Whether to stop capturing once the status is TRACKING, for a dry run in which the
                object does not move.
            stopwatch: Records the time of captures ("capture", which may include rendering), of
                the tracker ("tracking", parallel to the simulation) and of waiting ("waiting").
        """
        super().__init__()
        self._tracker, self._stopwatch = tracker, stopwatch or Stopwatch()
        self._min_interval, self._once = min_interval, once
        self._given_query = query_points
        if query_points is not None:
            self._given_query = frozen_array(
                query_points, name="PointTracker.query_points", shape=(num_points, 3)
            )
        self._cameras = CameraPorts(system=self, cameras=cameras)
        self._query = self.DeclareVectorInputPort("query_points", 3 * num_points)
        self._masks = self.DeclareAbstractInputPort("masks", Value(ABSENT))
        self._motion = self.DeclareVectorInputPort("object_motion", 16)
        self._nothing = TrackerRun(points=TrackedPoints.lost(num_points, -np.inf))
        self._frame = self.DeclareAbstractState(Value(ABSENT))
        self._runs = CaptureAndRelease(
            system=self,
            timing=timing or SimulatedDelay(),
            nothing=self._nothing,
            wanted=self._wanted,
            begin=self._begin,
            thread="tracker's thread",
            stopwatch=stopwatch,
        )
        DeclareTrackerOutputs(
            self,
            report=self._runs.result,
            num_points=num_points,
            prerequisites=self._runs.tickets,
        )
        self.DeclareStateOutputPort("frame", self._frame)
        self._runs.DeclareTimesPort()

    @property
    def worker_pid(self) -> int | None:
        """Process ID of the tracker if it is a `ProcessTracker`, else None."""
        return self._tracker.pid if isinstance(self._tracker, ProcessTracker) else None

    def close(self) -> None:
        """Ends the tracker's process and thread. A `ProcessTracker` aborts the work in progress.

        Later captures raise `StationError`.
        """
        if isinstance(self._tracker, ProcessTracker):
            self._tracker.abort()
        self._runs.close()
        if isinstance(self._tracker, ProcessTracker):
            self._tracker.close()

    def _wanted(self, context: Context, previous: Captured | None) -> bool:
        if self._once and self._runs.result(context).status is TrackerStatus.TRACKING:
            return False
        return previous is None or self._age_of_last(context) >= self._min_interval

    def _age_of_last(self, context: Context) -> float:
        """Returns the stamp of the images at the ports minus that of the last capture [s]."""
        # Reading the stamp is far cheaper than reading the images.
        frame: MultiViewFrame = context.get_abstract_state(self._frame).get_value()
        return self._cameras.stamp(context) - frame.stamp

    def _begin(
        self, context: Context, state: State, previous: Captured | None
    ) -> Callable[[], TrackerRun] | None:
        if previous is not None and not self._age_of_last(context) > 0.0:
            return None
        with self._stopwatch.measure("capture"):
            frame = self._cameras.capture(context)
        if frame is None:
            return None
        state.get_mutable_abstract_state(self._frame).set_value(frame)
        inputs = self._inputs(context, frame)

        def track() -> TrackerRun:
            run = self._nothing if previous is None else previous.result.result()
            with self._stopwatch.measure("tracking"):
                return advance(self._tracker, run, inputs)

        return track

    def _inputs(self, context: Context, frame: MultiViewFrame) -> TrackerInputs:
        query = self._given_query
        if self._query.HasValue(context):
            query = self._query.Eval(context).reshape(-1, 3).copy()
        motion = None
        if self._motion.HasValue(context):
            X_M = self._motion.Eval(context).reshape(4, 4).copy()
            motion = X_M if np.all(np.isfinite(X_M)) else None
        masks = self._masks.Eval(context) if self._masks.HasValue(context) else None
        return TrackerInputs(
            frame=frame,
            masks=masks if isinstance(masks, PartMasks) else None,
            query_points=query,
            object_motion=motion,
        )
