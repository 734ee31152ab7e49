"""A stand-in for the point tracker that reads the object's pose from the simulator."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, LeafSystem, State

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
    """Rate and latency of a `GroundTruthTracker`.

    Attributes:
        period: Time from one capture to the next [s].
        latency: Time from a capture to the release of its result [s]; 0: immediate release.
    """

    period: float = 1 / 8
    latency: float = 1 / 16


class GroundTruthTracker(LeafSystem):
    """Reports the true points at a tracker's rate and latency: a baseline for comparison.

    .. pydrake_system::

        name: GroundTruthTracker
        input_ports:
        - body_poses
        output_ports:
        - tracked_points
        - status
        - times

    Input: `body_poses`, the simulator's poses of all bodies. The first capture fixes the query
    points to the body.

    The outputs are those of `PointTracker`, functions of the state alone. Before the first release,
    all points are lost with a stamp of minus infinity, and `status` is WAITING.
    """

    def __init__(
        self,
        *,
        body_index: BodyIndex,
        query_points: np.ndarray,
        config: GroundTruthTrackerConfig | None = None,
    ):
        """Constructs the system.

        Args:
            body_index: Index of the object's body in `body_poses`.
            query_points: (N, 3) the points at the start [m, world].
            config: Rate and latency; None: the defaults.
        """
        super().__init__()
        config = config or GroundTruthTrackerConfig()
        self._body_index = body_index
        self._query_points = frozen_array(
            query_points, name="GroundTruthTracker.query_points", shape=("N", 3)
        )
        num_points = len(self._query_points)
        self._poses = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        self._body_points = self.DeclareDiscreteState(np.full(3 * num_points, np.nan))
        reports = CaptureAndRelease(
            system=self,
            timing=SimulatedDelay(period=config.period, latency=config.latency),
            nothing=TrackerRun(points=TrackedPoints.lost(num_points, -np.inf)),
            begin=self._begin,
        )
        DeclareTrackerOutputs(
            self, report=reports.result, num_points=num_points, prerequisites=reports.tickets
        )
        reports.DeclareTimesPort()

    def _begin(
        self, context: Context, state: State, previous: Captured | None
    ) -> Callable[[], TrackerRun]:
        X_WB = self._poses.Eval(context)[self._body_index].GetAsMatrix4()
        p_B = context.get_discrete_state(self._body_points).value().reshape(-1, 3)
        if np.isnan(p_B).all():
            p_B = transform_points(inverse(X_WB), self._query_points)
            state.get_mutable_discrete_state(self._body_points).SetFromVector(p_B.ravel())
        points = TrackedPoints(transform_points(X_WB, p_B), np.ones(len(p_B)), context.get_time())
        return lambda: TrackerRun(points=points, status=TrackerStatus.TRACKING)
