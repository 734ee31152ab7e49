"""The controller alone: it guides a free body, which starts far away, along an arc to rest."""

import sys

import numpy as np
from pydrake.geometry import StartMeshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    DiagramBuilder,
    LeafSystem,
)

from poil_drake.control import PointTrajectory
from poil_drake.geometry import make_transform, rotation_exp, skew, transform_points
from poil_drake.systems import PointSetBcsdm, PointSetVisualizer

# Ten points of a body go along an arc in 4 s, turn with it, and come to rest.
body_points = np.random.default_rng(0).uniform(-0.05, 0.05, size=(10, 3))
times = np.linspace(0.0, 4.0, 201)
turns = rotation_exp(np.outer(np.sin(np.pi / 8.0 * times), [0.0, 0.0, 1.5]))
X_WB = make_transform(turns, turns @ [0.4, -0.3, 0.0] + [0.0, 0.0, 0.4])
positions = transform_points(X_WB, body_points)
velocities = np.gradient(positions, times, axis=0)
velocities[-1] = 0.0
reference = PointTrajectory(times, positions, velocities)


class FreeBody(LeafSystem):
    """A body that moves as commanded: its pose is the integral of the spatial velocity."""

    def __init__(self) -> None:
        super().__init__()
        self._velocity = self.DeclareVectorInputPort("spatial_velocity", 6)
        self._pose = self.DeclareStateOutputPort("pose", self.DeclareContinuousState(16))
        self.DeclareVectorOutputPort("points", 30, self._calc_points, {self.xc_ticket()})

    def DoCalcTimeDerivatives(self, context: Context, derivatives: ContinuousState) -> None:
        """R' = skew(ω) R and p' = v for the pose (R, p) and the spatial velocity (ω, v)."""
        R, V = self._pose.Eval(context).reshape(4, 4)[:3, :3], self._velocity.Eval(context)
        X_dot = np.block([[skew(V[:3]) @ R, V[3:, None]], [np.zeros((1, 4))]])
        derivatives.SetFromVector(X_dot.ravel())

    def _calc_points(self, context: Context, output: BasicVector) -> None:
        X = self._pose.Eval(context).reshape(4, 4)
        output.SetFromVector(transform_points(X, body_points).ravel())


builder = DiagramBuilder()
body = builder.AddSystem(FreeBody())
bcsdm = builder.AddSystem(PointSetBcsdm(reference=reference))
builder.Connect(body.GetOutputPort("points"), bcsdm.GetInputPort("points"))
builder.Connect(body.GetOutputPort("pose"), bcsdm.GetInputPort("gripper_pose"))
builder.Connect(bcsdm.GetOutputPort("spatial_velocity"), body.GetInputPort("spatial_velocity"))
if "--meshcat" in sys.argv:
    drawing = builder.AddSystem(PointSetVisualizer(meshcat=StartMeshcat(), reference=reference))
    builder.Connect(body.GetOutputPort("points"), drawing.GetInputPort("points"))
    builder.Connect(bcsdm.GetOutputPort("target_points"), drawing.GetInputPort("target_points"))

simulator = Simulator(builder.Build())
if "--meshcat" in sys.argv:
    simulator.set_target_realtime_rate(1.0)
context = simulator.get_mutable_context()
start = make_transform(rotation_exp(np.array([2.5, 0.0, 1.0])), np.array([0.0, -0.6, 0.8]))
body.GetMyMutableContextFromRoot(context).SetContinuousState(start.ravel())
bcsdm_context = bcsdm.GetMyMutableContextFromRoot(context)
bcsdm.GetInputPort("confidence").FixValue(bcsdm_context, np.ones(10))
for time in range(9):
    simulator.AdvanceTo(time)
    goal_error = bcsdm.GetOutputPort("goal_error").Eval(bcsdm_context)[0]
    print(f"{time} s: {1000 * goal_error:6.1f} mm from the goal")
