"""At one instant the tracker updates first, then its consumers; publishing comes last."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from poil_drake.systems.ik.arm_kinematics import ArmKinematics
from poil_drake.systems.propagation.fk_propagator import FkPropagator
from poil_drake.systems.tracking.ground_truth_tracker import (
    GroundTruthTracker,
    GroundTruthTrackerConfig,
)

CONTROL, TRACKER, LATENCY = 1 / 256, 1 / 8, 1 / 16
QUERY = np.array([[0.5, 0.0, 0.1], [0.6, 0.0, 0.1], [0.5, 0.1, 0.2]])


class RisingBody(LeafSystem):
    """The poses of the world and of a body that rises by 1 m/s."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareAbstractOutputPort(
            "body_poses",
            lambda: AbstractValue.Make([RigidTransform()]),
            self._calc,
            {self.time_ticket()},
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        rise = RigidTransform([0.0, 0.0, context.get_time()])
        output.set_value([RigidTransform(), rise])


class Recorder(LeafSystem):
    """Records at every publish the tracker's stamp and the height of the propagator's points."""

    def __init__(self, period: float):
        super().__init__()
        self.seen: dict[float, tuple[float, float]] = {}
        self._tracked = self.DeclareAbstractInputPort("tracked_points", Value(object()))
        self._points = self.DeclareVectorInputPort("points", 3 * len(QUERY))
        self.DeclarePeriodicPublishEvent(period, 0.0, self._record)

    def _record(self, context: Context) -> None:
        height = self._points.Eval(context)[2] - QUERY[0, 2]
        self.seen[context.get_time()] = (self._tracked.Eval(context).stamp, height)


@pytest.fixture
def recorder() -> Recorder:
    return Recorder(CONTROL / 2)  # So that it also publishes between two ticks.


@pytest.fixture
def simulator(two_joint_arm: ArmKinematics, recorder: Recorder) -> Simulator:
    """Tracker, propagator and recorder, added in the opposite order."""
    builder = DiagramBuilder()
    builder.AddSystem(recorder)
    propagator = builder.AddSystem(
        FkPropagator(num_points=3, kinematics=two_joint_arm, period=CONTROL)
    )
    tracker = builder.AddSystem(
        GroundTruthTracker(
            body_index=BodyIndex(1),
            num_points=3,
            query_points=QUERY,
            config=GroundTruthTrackerConfig(period=TRACKER, latency=LATENCY),
        )
    )
    body = builder.AddSystem(RisingBody())
    rest, free = (builder.AddSystem(ConstantVectorSource(v)) for v in ([0.1, 0.2], [0.0]))
    tracked = tracker.GetOutputPort("tracked_points")
    builder.Connect(body.GetOutputPort("body_poses"), tracker.GetInputPort("body_poses"))
    builder.Connect(tracked, propagator.GetInputPort("tracked_points"))
    builder.Connect(rest.get_output_port(), propagator.GetInputPort("position_measured"))
    builder.Connect(free.get_output_port(), propagator.GetInputPort("holding"))
    builder.Connect(tracked, recorder.GetInputPort("tracked_points"))
    builder.Connect(propagator.GetOutputPort("points"), recorder.GetInputPort("points"))
    return Simulator(builder.Build())


def test_the_propagator_uses_a_track_at_the_instant_of_its_release(
    simulator: Simulator, recorder: Recorder
) -> None:
    simulator.AdvanceTo(1.0)

    assert {stamp for stamp, _ in recorder.seen.values()} > {0.0, TRACKER, 2 * TRACKER}
    for stamp, height in recorder.seen.values():
        if np.isfinite(stamp):
            assert height == pytest.approx(stamp)
        else:
            assert np.isnan(height)


def test_publishing_at_an_instant_sees_the_state_before_its_updates(
    simulator: Simulator, recorder: Recorder
) -> None:
    simulator.AdvanceTo(0.5)

    # A publish closes the step that ends at its time; the updates at that time open the next one.
    release = 2 * TRACKER + LATENCY
    assert recorder.seen[release][0] == TRACKER
    assert recorder.seen[release + CONTROL][0] == 2 * TRACKER


def test_the_first_capture_happens_at_time_zero(simulator: Simulator, recorder: Recorder) -> None:
    simulator.AdvanceTo(LATENCY + 2 * CONTROL)

    assert recorder.seen[0.0][0] == -np.inf
    assert recorder.seen[LATENCY][0] == -np.inf
    assert recorder.seen[LATENCY + CONTROL][0] == 0.0
