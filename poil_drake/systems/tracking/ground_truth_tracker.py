"""A stand-in for the point tracker that reads the object's pose from the simulator."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.capture_and_release import CaptureAndRelease
from poil_drake.systems.capture_timing import Captured, SimulatedDelay
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.tracker_outputs import DeclareTrackerOutputs
from poil_drake.systems.tracking.tracker_run import TrackerRun


@dataclass(frozen=True, kw_only=True)
class GroundTruthTrackerConfig:
    """Rate, latency and errors of a `GroundTruthTracker`.

    Attributes:
        period: Time from one capture to the next [s].
        latency: Time from a capture to the release of its result [s]; 0: immediate release.
        noise: Standard deviation of the error of each coordinate [m]; errors are independent.
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
                f"GroundTruthTrackerConfig has noise={self.noise} m, point_dropout="
                f"{self.point_dropout} and frame_dropout={self.frame_dropout}, of which at least "
                "one is out of range.",
                remedy="Set a noise of at least 0 m, and dropout probabilities in [0, 1].",
            )


def observe(
    points: np.ndarray, stamp: float, tick: int, config: GroundTruthTrackerConfig
) -> TrackedPoints:
    """Returns the true points with simulated noise and dropouts.

    Points that drop out are NaN and have confidence 0; all others have confidence 1. Noise and
    dropouts depend on the seed and the tick alone.

    Args:
        points: (N, 3) the true points [m, world].
        stamp: Capture time [s].
        tick: Number of the capture.
        config: Size of the noise, probabilities of dropouts, and the seed.
    """
    rng = np.random.default_rng([config.seed, tick])
    frame_seen = rng.random() >= config.frame_dropout
    seen = (rng.random(len(points)) >= config.point_dropout) & frame_seen
    noisy = points + config.noise * rng.standard_normal(points.shape)
    return TrackedPoints(np.where(seen[:, None], noisy, np.nan), seen.astype(float), stamp)


class GroundTruthTracker(LeafSystem):
    """Reports the true points at a tracker's rate and latency: a baseline for comparison.

    .. pydrake_system::

        name: GroundTruthTracker
        input_ports:
        - body_poses
        - query_points
        output_ports:
        - tracked_points
        - status
        - times

    Inputs: `body_poses`, the simulator's poses of all bodies; `query_points` (3N,) row-major, the
    points at the start [m, world], NaN until known (optional if the constructor gets them). The
    first capture at which the query points are known fixes them to the body.

    The outputs are those of `PointTracker`, functions of the state alone. Before the first release,
    all points are lost with a stamp of minus infinity, and `status` is WAITING. `status` is LOST if
    no point was observed.
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
            body_index: Index of the object's body in `body_poses`.
            num_points: Number of points, N.
            query_points: (N, 3) the points at the start [m, world]; a connected port replaces them.
            config: Rate, latency and errors; None: the defaults.
        """
        super().__init__()
        self._body_index = body_index
        self._config = config or GroundTruthTrackerConfig()
        self._given_query = query_points
        if query_points is not None:
            self._given_query = frozen_array(
                query_points, name="GroundTruthTracker.query_points", shape=(num_points, 3)
            )
        self._poses = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        self._query = self.DeclareVectorInputPort("query_points", 3 * num_points)
        self._body_points = self.DeclareDiscreteState(np.full(3 * num_points, np.nan))
        reports = CaptureAndRelease(
            system=self,
            timing=SimulatedDelay(period=self._config.period, latency=self._config.latency),
            nothing=TrackerRun(points=TrackedPoints.lost(num_points, -np.inf)),
            begin=self._begin,
        )
        DeclareTrackerOutputs(
            self, report=reports.result, num_points=num_points, prerequisites=reports.tickets
        )
        reports.DeclareTimesPort()

    def _begin(
        self, context: Context, state: State, previous: Captured | None
    ) -> Callable[[], TrackerRun] | None:
        X_WB = self._poses.Eval(context)[self._body_index].GetAsMatrix4()
        p_B = context.get_discrete_state(self._body_points).value().reshape(-1, 3)
        if not np.all(np.isfinite(p_B)):
            query = self._given_query
            if self._query.HasValue(context):
                query = self._query.Eval(context).reshape(-1, 3)
            if query is None or not np.all(np.isfinite(query)):
                return None
            p_B = transform_points(inverse(X_WB), query)
            state.get_mutable_discrete_state(self._body_points).SetFromVector(p_B.ravel())
        time = context.get_time()
        tick = round(time / self._config.period)
        points = observe(transform_points(X_WB, p_B), time, tick, self._config)
        seen = bool(np.any(points.confidence > 0.0))
        status = TrackerStatus.TRACKING if seen else TrackerStatus.LOST
        return lambda: TrackerRun(points=points, status=status)
