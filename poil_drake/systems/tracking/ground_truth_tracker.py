"""A stand-in for the point tracker that reads the object's pose out of the simulator."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.release_schedule import Captured, ReleaseSchedule


@dataclass(frozen=True, kw_only=True)
class GroundTruthTrackerConfig:
    """How good this tracker is.

    Attributes:
        period: From one capture to the next [s]; that of the tracker it stands in for.
        latency: From a capture to the release of its result [s]. 0: released at once.
        noise: Standard deviation of each coordinate, independent in points and time [m].
        point_dropout: Probability that a point is not observed in a frame.
        frame_dropout: Probability that the object is lost in a frame.
        seed: Seed of noise and dropouts.
    """

    period: float = 1 / 8
    latency: float = 1 / 16
    noise: float = 0.0
    point_dropout: float = 0.0
    frame_dropout: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.noise < 0.0 or not 0 <= self.point_dropout <= 1 or not 0 <= self.frame_dropout <= 1:
            raise InvalidValueError(
                f"The noise is {self.noise} m, the dropouts are {self.point_dropout} and "
                f"{self.frame_dropout}.",
                remedy="Noise is not negative and probabilities lie in [0, 1].",
            )


@dataclass(frozen=True, eq=False)
class _Report(SharedOnCopy):
    points: TrackedPoints
    status: TrackerStatus
    captured: float = -np.inf


def observe(
    points: np.ndarray, stamp: float, tick: int, config: GroundTruthTrackerConfig
) -> TrackedPoints:
    """Returns true points (N, 3) [m, world] as this tracker sees them.

    The same seed and tick give the same noise, whatever happened before.

    Args:
        points: (N, 3) where they are [m, world].
        stamp: Time of capture [s].
        tick: Number of the capture.
        config: Noise and dropouts.
    """
    rng = np.random.default_rng([config.seed, tick])
    frame_seen = rng.random() >= config.frame_dropout
    seen = (rng.random(len(points)) >= config.point_dropout) & frame_seen
    noisy = points + config.noise * rng.standard_normal(points.shape)
    return TrackedPoints(np.where(seen[:, None], noisy, np.nan), seen.astype(float), stamp)


class GroundTruthTracker(LeafSystem):
    """Reports where the points truly are, at a tracker's rate and latency: a labelled baseline.

    .. pydrake_system::

        name: GroundTruthTracker
        input_ports:
        - body_poses
        - query_points
        output_ports:
        - tracked_points
        - status
        - times

    Inputs: `body_poses`, the simulator's poses of all bodies; `query_points` (3N,) row-major, where
    the points are at first [m, world], NaN until known (may stay unconnected when the constructor
    gets them). At the first capture that knows them they are fixed to the body. Outputs are as
    `PointTracker`'s, functions of the state alone: before the first release `tracked_points` are
    lost with a stamp of minus infinity and `status` is WAITING; `status` is LOST where no point was
    observed.
    """

    def __init__(
        self,
        *,
        body_index: BodyIndex,
        num_points: int,
        query_points: np.ndarray | None = None,
        config: GroundTruthTrackerConfig | None = None,
    ):
        """Constructs the system.

        Args:
            body_index: The object's body in `body_poses`.
            num_points: How many points are followed, N.
            query_points: (N, 3) where they are at first [m, world]; None: the port says.
            config: Rate, latency, noise.
        """
        super().__init__()
        self._body_index = body_index
        self._config = config or GroundTruthTrackerConfig()
        self._schedule = ReleaseSchedule(period=self._config.period, latency=self._config.latency)
        self._given_query = query_points
        if query_points is not None:
            self._given_query = frozen_array(
                query_points, name="GroundTruthTracker.query_points", shape=(num_points, 3)
            )
        self._poses = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        self._query = self.DeclareVectorInputPort("query_points", 3 * num_points)
        nothing = _Report(TrackedPoints.lost(num_points, -np.inf), TrackerStatus.WAITING)
        self._body_points = self.DeclareDiscreteState(np.full(3 * num_points, np.nan))
        self._queue = self.DeclareAbstractState(Value(()))
        self._released = self.DeclareAbstractState(Value(nothing))
        self._times = self.DeclareDiscreteState(np.full(3, -np.inf))
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._config.period, 0.0, self._capture)
        if not self._schedule.immediate:
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                self._config.period, self._config.latency, self._release
            )
        released = {self.abstract_state_ticket(self._released)}
        self.DeclareAbstractOutputPort(
            "tracked_points", lambda: Value(nothing.points), self._calc_points, released
        )
        self.DeclareVectorOutputPort("status", 1, self._calc_status, released)
        self.DeclareStateOutputPort("times", self._times)

    def _calc_points(self, context: Context, output: AbstractValue) -> None:
        output.set_value(context.get_abstract_state(self._released).get_value().points)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        status = context.get_abstract_state(self._released).get_value().status
        output.SetAtIndex(0, float(status))

    def _capture(self, context: Context, state: State) -> None:
        X_WB = self._poses.Eval(context)[self._body_index].GetAsMatrix4()
        p_B = context.get_discrete_state(self._body_points).value().reshape(-1, 3)
        if not np.all(np.isfinite(p_B)):
            query = self._given_query
            if self._query.HasValue(context):
                query = self._query.Eval(context).reshape(-1, 3)
            if query is None or not np.all(np.isfinite(query)):
                return
            p_B = transform_points(inverse(X_WB), query)
            state.get_mutable_discrete_state(self._body_points).SetFromVector(p_B.ravel())
        time = context.get_time()
        tick = self._schedule.capture_tick(time)
        points = observe(transform_points(X_WB, p_B), time, tick, self._config)
        seen = bool(np.any(points.confidence > 0.0))
        report = _Report(points, TrackerStatus.TRACKING if seen else TrackerStatus.LOST, time)
        queue: tuple[Captured, ...] = context.get_abstract_state(self._queue).get_value()
        queue = self._schedule.added(queue, time, report)
        state.get_mutable_abstract_state(self._queue).set_value(queue)
        state.get_mutable_discrete_state(self._times).SetAtIndex(0, time)
        if self._schedule.immediate:
            self._show(report, context, state)

    def _release(self, context: Context, state: State) -> None:
        queue = context.get_abstract_state(self._queue).get_value()
        due = self._schedule.due(queue, context.get_time())
        if due is not None:
            self._show(due.item, context, state)

    def _show(self, report: _Report, context: Context, state: State) -> None:
        state.get_mutable_abstract_state(self._released).set_value(report)
        times = state.get_mutable_discrete_state(self._times)
        times.SetAtIndex(1, context.get_time())
        times.SetAtIndex(2, report.captured)
