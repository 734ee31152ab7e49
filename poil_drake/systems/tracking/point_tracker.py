"""Follows the part points through the camera images."""

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    AbstractStateIndex,
    BasicVector,
    Context,
    LeafSystem,
    State,
)

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers import protocol
from poil_drake.perception.trackers.process_tracker import ProcessTracker
from poil_drake.runtime.background_thread import Background
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.cameras.camera_ports import CameraPorts
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.recorded_schedule import RecordedSchedule
from poil_drake.systems.tracking.release_schedule import Captured, ReleaseSchedule
from poil_drake.systems.tracking.tracker_run import TrackerInputs, TrackerRun, advance


@dataclass(frozen=True, kw_only=True)
class PointTrackerConfig:
    """When the tracker runs.

    Attributes:
        period: From one capture to the next [s]; about what a tracker manages.
        offset: Time of the first capture [s]: shortly after images appear that are delayed.
        latency: From a capture to the release of its result [s]. 0: released at once.
        parallel: Whether the work is done on a thread beside the simulation.
        blocking: Whether the release awaits the work. In simulation it must, so that the outcome
            does not depend on timing. On hardware it must not: a result is released when it is
            there, at the first poll after its latency, and frames that come meanwhile are skipped.
        poll_period: How often to look for a result when not blocking [s].
        min_interval: From the image of one capture to that of the next, at least [s]: where
            `period` is how often to look for new images, and cameras are faster than the tracker
            shall be.
        once: Whether to look no more once the points were found: for a rehearsal in which what the
            cameras see does not move.
        recorded: When captures and releases happened in a run that is replayed. They happen then
            again, however long the work takes now, and `period`, `offset` and `poll_period` only
            tell how often to look if one is due. None: as the rest says.
    """

    period: float = 1 / 8
    offset: float = 0.0
    latency: float = 1 / 16
    parallel: bool = True
    blocking: bool = True
    poll_period: float = 1 / 256
    min_interval: float = 0.0
    once: bool = False
    recorded: RecordedSchedule | None = None

    def __post_init__(self) -> None:
        if not self.blocking and not self.parallel:
            raise InvalidValueError(
                "PointTrackerConfig.blocking is off, but so is parallel.",
                remedy="A tracker that is not awaited has to run in parallel.",
            )
        if self.recorded is not None and not self.blocking:
            raise InvalidValueError(
                "PointTrackerConfig.recorded is given, but blocking is off.",
                remedy="A replay has to await what was there at the time.",
            )


@dataclass(frozen=True, eq=False)
class _Work(SharedOnCopy):
    """A run that is being computed; it is shared by all copies of the state that holds it."""

    future: Future[TrackerRun]
    stamp: float
    captured: float


class PointTracker(LeafSystem):
    """Runs a tracker on the cameras at its own rate, and releases each result after a latency.

    .. pydrake_system::

        name: PointTracker
        input_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.image_time
        - query_points
        - masks
        - object_motion
        output_ports:
        - tracked_points
        - status
        - frame
        - times

    Inputs: `query_points` (3N,) row-major, where the points are at first [m, world], NaN until
    known (may stay unconnected when the constructor gets them); `masks`, the detector's
    `PartMasks`, anything else until known; `object_motion` (16,) X_M row-major, by forward
    kinematics (may stay unconnected or NaN: no prior). The logic of starting, stepping and starting
    anew is in `tracker_run.advance`. Every output is a function of the state alone:

    - `tracked_points`: `TrackedPoints` with the stamp of their capture. Before the first release
      they are lost, with a stamp of minus infinity; those of a lost object have confidence 0.
    - `status` (1,): a `TrackerStatus` as of the last release; WAITING until query points and masks
      were known at a capture.
    - `frame`: the `MultiViewFrame` of the last capture; `ABSENT` before the first.
    - `times` (3,) [s]: of the last capture, of the last release, and of the capture whose result
      that was; minus infinity before.

    Captures are unrestricted updates at `offset` and every period after it, releases are
    unrestricted updates `latency` later. Images whose stamp does not advance are not tracked, so
    that the track of a frozen camera ages. `object_motion` is to be of the images' time;
    what a capture sees was written at the control tick before.
    """

    def __init__(
        self,
        *,
        tracker: protocol.PointTracker,
        cameras: Sequence[CameraModel],
        num_points: int,
        query_points: np.ndarray | None = None,
        config: PointTrackerConfig | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the system.

        Args:
            tracker: What tracks; a `ProcessTracker` leaves the interpreter to the simulation.
            cameras: The cameras' models, in the order of the views.
            num_points: How many points are followed, N.
            query_points: (N, 3) where they are at first [m, world]; None: the port says.
            config: When it runs.
            stopwatch: Where to note how long captures take ("capture", which is rendering where the
                cameras do not delay), steps ("tracking", beside the simulation) and waiting for
                them ("waiting").
        """
        super().__init__()
        self._tracker, self._stopwatch = tracker, stopwatch or Stopwatch()
        self._config = config or PointTrackerConfig()
        self._schedule = self._config.recorded or ReleaseSchedule(
            period=self._config.period, latency=self._config.latency, offset=self._config.offset
        )
        self._given_query = query_points
        if query_points is not None:
            self._given_query = frozen_array(
                query_points, name="PointTracker.query_points", shape=(num_points, 3)
            )
        self._background = Background("tracker's thread") if self._config.parallel else None
        self._cameras = CameraPorts(system=self, cameras=cameras)
        self._query = self.DeclareVectorInputPort("query_points", 3 * num_points)
        self._masks = self.DeclareAbstractInputPort("masks", Value(ABSENT))
        self._motion = self.DeclareVectorInputPort("object_motion", 16)

        self._nothing = TrackerRun(points=TrackedPoints.lost(num_points, -np.inf))
        self._frame = self.DeclareAbstractState(Value(ABSENT))
        self._queue = self.DeclareAbstractState(Value(()))
        self._released = self.DeclareAbstractState(Value(Captured(-1, self._nothing)))
        self._times = self.DeclareDiscreteState(np.full(3, -np.inf))
        self._declare_events()

        released = {self.abstract_state_ticket(self._released)}
        self.DeclareAbstractOutputPort(
            "tracked_points", lambda: Value(self._nothing.points), self._calc_points, released
        )
        self.DeclareVectorOutputPort("status", 1, self._calc_status, released)
        self.DeclareStateOutputPort("frame", self._frame)
        self.DeclareStateOutputPort("times", self._times)

    @property
    def worker_pid(self) -> int | None:
        """Number of the tracker's process; None where it has none."""
        return self._tracker.pid if isinstance(self._tracker, ProcessTracker) else None

    def close(self) -> None:
        """Ends the workers. No capture may follow.

        What they are doing is finished first, or given up where nobody awaits it.
        """
        if isinstance(self._tracker, ProcessTracker) and not self._config.blocking:
            self._tracker.abort()
        if self._background is not None:
            self._background.close()
        if isinstance(self._tracker, ProcessTracker):
            self._tracker.close()

    def _declare_events(self) -> None:
        config = self._config
        self.DeclarePeriodicUnrestrictedUpdateEvent(config.period, config.offset, self._capture)
        if config.recorded is not None:
            self.DeclarePeriodicUnrestrictedUpdateEvent(config.poll_period, 0.0, self._release)
        elif not config.blocking:
            self.DeclarePeriodicUnrestrictedUpdateEvent(config.poll_period, 0.0, self._poll)
        elif not self._immediate:
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                config.period, config.offset + config.latency, self._release
            )

    @property
    def _immediate(self) -> bool:
        return isinstance(self._schedule, ReleaseSchedule) and self._schedule.immediate

    def _get(self, context: Context, index: AbstractStateIndex) -> Any:
        return context.get_abstract_state(index).get_value()

    def _calc_points(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._get(context, self._released).item.points)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self._get(context, self._released).item.status))

    def _capture(self, context: Context, state: State) -> None:
        queue: tuple[Captured, ...] = self._get(context, self._queue)
        previous: _Work | None = queue[-1].item if queue else None
        if self._config.recorded is not None:
            last = queue[-1].tick if queue else -1
            if self._config.recorded.capture_tick(context.get_time()) <= last:
                return
        elif previous is not None:
            if not self._config.blocking and not previous.future.done():
                return
            if self._config.once and _found(previous):
                return
        # To look at images costs more than to see that they are old.
        if previous and not self._is_news(self._cameras.stamp(context), previous.stamp):
            return
        with self._stopwatch.measure("capture"):
            frame = self._cameras.capture(context)
        if frame is None:
            return
        work = self._begin(previous, self._inputs(context, frame), context.get_time())
        queue = self._schedule.added(queue, context.get_time(), work)
        state.get_mutable_abstract_state(self._queue).set_value(queue)
        state.get_mutable_abstract_state(self._frame).set_value(frame)
        state.get_mutable_discrete_state(self._times).SetAtIndex(0, context.get_time())
        if self._config.blocking and self._immediate:
            self._show(queue[-1], context, state)

    def _is_news(self, stamp: float, before: float) -> bool:
        return stamp > before and stamp - before >= self._config.min_interval

    def _release(self, context: Context, state: State) -> None:
        due = self._schedule.due(self._get(context, self._queue), context.get_time())
        if due is not None and due.tick > self._get(context, self._released).tick:
            self._show(due, context, state)

    def _poll(self, context: Context, state: State) -> None:
        assert isinstance(self._schedule, ReleaseSchedule)
        last = self._get(context, self._released).tick
        for entry in reversed(self._get(context, self._queue)):
            ripe = context.get_time() >= self._schedule.release_time(entry.tick)
            if entry.tick > last and ripe and entry.item.future.done():
                self._show(entry, context, state)
                return

    def _show(self, entry: Captured, context: Context, state: State) -> None:
        """Awaits the entry's result and makes it the released one."""
        with self._stopwatch.measure("waiting"):
            result = entry.item.future.result()
        times = state.get_mutable_discrete_state(self._times)
        times.SetAtIndex(1, context.get_time())
        times.SetAtIndex(2, entry.item.captured)
        state.get_mutable_abstract_state(self._released).set_value(Captured(entry.tick, result))

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

    def _begin(self, previous: _Work | None, inputs: TrackerInputs, now: float) -> _Work:
        """Begins to compute the next run; it continues the previous one once that is there."""

        def compute() -> TrackerRun:
            run = self._nothing if previous is None else previous.future.result()
            with self._stopwatch.measure("tracking"):
                return advance(self._tracker, run, inputs)

        future: Future[TrackerRun]
        if self._background is not None:
            future = self._background.submit(compute)
        else:
            future = Future()
            future.set_result(compute())
        return _Work(future, inputs.frame.stamp, now)


def _found(work: _Work) -> bool:
    return work.future.done() and work.future.result().status is TrackerStatus.TRACKING
