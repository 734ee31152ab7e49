"""Your own system in place of the tracker: it follows the poses that a pose estimator reports.

Needs a plan from `poil transfer`: python examples/own_tracker.py out/plan.npz
"""

import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, LeafSystem, State

import poil_drake as poil
from poil_drake.geometry import inverse, transform_points
from poil_drake.perception import TrackedPoints
from poil_drake.systems import (
    CaptureAndRelease,
    DeclareTrackerOutputs,
    Phase,
    SimulatedDelay,
    TrackerStatus,
)


class Report(NamedTuple):
    """What the tracker outputs for one capture."""

    points: TrackedPoints
    status: TrackerStatus


class PoseTracker(LeafSystem):
    """Moves the plan's points with the object's pose, 20 times a second, 50 ms late.

    The loop connects the tracker's input ports by name. `body_poses` holds the simulator's poses;
    added noise imitates a pose estimator. A tracker that uses images would have input ports such as
    `left.rgb_image` instead.
    """

    def __init__(self, station: poil.Station, plan: poil.ExecutionPlan):
        super().__init__()
        body = station.object_body()
        X_WB = body.EvalPoseInWorld(station.plant().CreateDefaultContext()).GetAsMatrix4()
        self._body, self._p_B = body.index(), transform_points(inverse(X_WB), plan.target_points)
        poses = AbstractValue.Make([RigidTransform()])
        self._poses = self.DeclareAbstractInputPort("body_poses", poses)
        num_points = len(plan.target_points)
        reports = CaptureAndRelease(
            system=self,
            timing=SimulatedDelay(period=1 / 20, latency=0.05),
            nothing=Report(TrackedPoints.lost(num_points, -np.inf), TrackerStatus.WAITING),
            begin=self._begin,
        )
        DeclareTrackerOutputs(
            self, report=reports.result, num_points=num_points, prerequisites=reports.tickets
        )
        reports.DeclareTimesPort()

    def _begin(self, context: Context, state: State, previous: object) -> Callable[[], Report]:
        X_WB = self._poses.Eval(context)[self._body].GetAsMatrix4()
        noise = np.random.default_rng(round(20 * context.get_time())).standard_normal(3)
        points = transform_points(X_WB, self._p_B) + 0.001 * noise
        tracked = TrackedPoints(points, np.ones(len(points)), context.get_time())
        return lambda: Report(tracked, TrackerStatus.TRACKING)


def read(system: LeafSystem, port: str) -> float:
    """Returns the value of a scalar output port."""
    context = system.GetMyContextFromRoot(simulator.get_context())
    return float(system.GetOutputPort(port).Eval(context)[0])


plan = poil.ExecutionPlan.load(sys.argv[1])
scenario = poil.LoadScenario(filename=poil.default_scenario_file())
station = poil.MakeStation(scenario, cameras=False)
tracker = PoseTracker(station, plan)
with poil.MakeClosedLoop(scenario, plan, station=station, tracker=tracker) as loop:
    simulator = Simulator(loop.diagram)
    last_phase = Phase.WAIT
    for time in np.arange(0.0, 16.25, 0.25):
        simulator.AdvanceTo(time)
        phase = Phase(int(read(loop.sequencer, "phase")))
        if phase is not last_phase:
            error = 1000.0 * read(loop.controller, "goal_error")
            print(f"{time:5.2f} s: {phase.name.lower()}, {error:.1f} mm from the goal")
        last_phase = phase
