"""The simulation in which all policies of the control study are tried."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.geometry import SceneGraph, SceneGraphConfig
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem

from poil_drake.benchmarks.control.arena.contact_monitor import ContactMonitor
from poil_drake.benchmarks.control.arena.delayed_tracking import DelayedTracking
from poil_drake.benchmarks.control.arena.direct_actuation import (
    ActuationConfig,
    DirectActuation,
    Slip,
)
from poil_drake.benchmarks.control.arena.point_observer import PointObserver
from poil_drake.benchmarks.control.arena.task import MODELS, ControlTask
from poil_drake.benchmarks.control.policies.policy import Policy
from poil_drake.benchmarks.control.policies.policy_system import PolicySystem

_MODULUS = 1e7  # [Pa], of hard rubber: 5 N press boxes together by micrometres, a rod by 3 mm.
_RESOLUTION = 0.01  # Of round shapes' meshes [m].


@dataclass(frozen=True, kw_only=True)
class ArenaConfig:
    """The physics, the same for all policies.

    Attributes:
        time_step: Of the plant [s]. At the speed limits the far side of an object moves 4 mm.
        max_angular_speed: Of commanded twists [rad/s].
        max_linear_speed: Of commanded twists [m/s].
        actuation: The hand that moves the object.
    """

    time_step: float = 1 / 128
    max_angular_speed: float = 2.0
    max_linear_speed: float = 0.25
    actuation: ActuationConfig = field(default_factory=ActuationConfig)


def AddTaskPlant(
    builder: DiagramBuilder, task: ControlTask, time_step: float
) -> tuple[MultibodyPlant, SceneGraph, RigidBody]:
    """Adds the task's object and fixtures.

    Weight is compensated where the object is rigid; a deforming one hangs in the hand. Contact is
    hydroelastic: where two boxes meet, a single point of contact lets one turn into the other.

    Returns:
        The finalized plant, its scene graph, and the driven body.
    """
    config = MultibodyPlantConfig(
        time_step=time_step,
        contact_model="hydroelastic_with_fallback",
        discrete_contact_approximation="lagged",
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    scene_config = SceneGraphConfig()
    properties = scene_config.default_proximity_properties
    properties.compliance_type = "compliant"
    properties.hydroelastic_modulus = _MODULUS
    properties.resolution_hint = _RESOLUTION
    scene_config.default_proximity_properties = properties
    scene_graph.set_config(scene_config)
    parser = Parser(plant)
    for fixture in task.fixtures:
        (instance,) = parser.AddModels(str(MODELS / fixture.file))
        frame = plant.GetBodyByName(fixture.link, instance).body_frame()
        plant.WeldFrames(plant.world_frame(), frame, RigidTransform(np.array(fixture.position)))
    (instance,) = parser.AddModels(str(MODELS / task.object_file))
    if task.rigid:
        plant.set_gravity_enabled(instance, False)
    plant.Finalize()
    return plant, scene_graph, plant.get_body(plant.GetBodyIndices(instance)[0])


class Arena:
    """A diagram of plant, policy, hand, observer and contact monitor."""

    def __init__(
        self,
        task: ControlTask,
        policy: Policy,
        *,
        config: ArenaConfig | None = None,
        intended_contact: np.ndarray | None = None,
        tracker: DelayedTracking | None = None,
    ):
        """Builds the diagram.

        Args:
            task: What is moved where.
            policy: Who moves it.
            config: The physics.
            intended_contact: See `ContactMonitor`.
            tracker: What stands between the true points and the policy; None shows it the truth.
        """
        config = config or ArenaConfig()
        self.task, self._tracker = task, tracker
        builder = DiagramBuilder()
        self.plant, self._scene_graph, self.body = AddTaskPlant(builder, task, config.time_step)
        plant, n = self.plant, len(task.link_points)
        instance = self.body.model_instance()
        self._observer = PointObserver(
            plant=plant,
            body=self.body,
            carriers=[plant.GetBodyByName(name, instance) for name in task.carriers],
            p_BP=task.link_points,
        )
        self._policy = PolicySystem(
            policy=policy,
            num_points=n,
            max_angular_speed=config.max_angular_speed,
            max_linear_speed=config.max_linear_speed,
        )
        self._hand = DirectActuation(plant=plant, body=self.body, config=config.actuation)
        self._monitor = ContactMonitor(
            plant=plant, body=self.body, num_points=n, intended=intended_contact
        )
        self._connect(builder)
        builder.ExportOutput(self._scene_graph.get_query_output_port(), "query_object")
        self.diagram: Diagram = builder.Build()

    def _connect(self, builder: DiagramBuilder) -> None:
        """Adds the systems and connects each of their inputs to the output of the same name."""
        systems = [self._observer, self._policy, self._hand, self._monitor]
        for system in systems:
            builder.AddSystem(system)
        sources = _outputs(*systems)
        sources |= {
            "body_poses": self.plant.get_body_poses_output_port(),
            "body_spatial_velocities": self.plant.get_body_spatial_velocities_output_port(),
            "contact_results": self.plant.get_contact_results_output_port(),
            "query_object": self._scene_graph.get_query_output_port(),
        }
        seen = dict(sources)
        if self._tracker is not None:
            builder.AddSystem(self._tracker)
            _connect(builder, self._tracker, sources)
            seen |= _outputs(self._tracker)
        for system in systems:
            _connect(builder, system, seen if system is self._policy else sources)
        builder.Connect(
            self._hand.GetOutputPort("applied_spatial_force"),
            self.plant.get_applied_spatial_force_input_port(),
        )

    def points(self, context: Context) -> np.ndarray:
        """Returns where the points truly are, (N, 3) [m, world]."""
        own = self._observer.GetMyContextFromRoot(context)
        return self._observer.GetOutputPort("points").Eval(own).reshape(-1, 3)

    def pose(self, context: Context) -> np.ndarray:
        """Returns X_WO (4, 4) of the driven body."""
        own = self._observer.GetMyContextFromRoot(context)
        return self._observer.GetOutputPort("object_pose").Eval(own).reshape(4, 4)

    def contact(self, context: Context) -> tuple[float, float]:
        """Returns impulse [N s] and deepest penetration [m] so far."""
        own = self._monitor.GetMyContextFromRoot(context)
        impulse, depth = (
            float(self._monitor.GetOutputPort(name).Eval(own)[0]) for name in ("impulse", "depth")
        )
        return impulse, depth

    def policy_state(self, context: Context) -> object:
        """Returns the policy's state."""
        return self._policy.GetPolicyState(self._policy.GetMyContextFromRoot(context))

    def SetSlip(self, context: Context, slip: Slip) -> None:
        """Says how the object will slip in the hand."""
        self._hand.SetSlip(self._hand.GetMyMutableContextFromRoot(context), slip)

    def SetNoiseSeed(self, context: Context, seed: int) -> None:
        """Seeds the tracker's noise, where there is a tracker."""
        if self._tracker is not None:
            self._tracker.SetSeed(self._tracker.GetMyMutableContextFromRoot(context), seed)

    def place(self, context: Context, X_WO: np.ndarray, shape: np.ndarray) -> None:
        """Puts the object somewhere, at rest.

        Args:
            context: The diagram's.
            X_WO: (4, 4) pose of the driven body.
            shape: Positions of the object's joints besides that pose.
        """
        plant_context = self.plant.GetMyMutableContextFromRoot(context)
        instance = self.body.model_instance()
        q = self.plant.GetPositions(plant_context, instance)
        q[7:] = shape
        self.plant.SetPositions(plant_context, instance, q)
        self.plant.SetFreeBodyPose(plant_context, self.body, RigidTransform(X_WO))

    def shape(self, context: Context) -> np.ndarray:
        """Returns the positions of the object's joints besides its pose."""
        plant_context = self.plant.GetMyContextFromRoot(context)
        return self.plant.GetPositions(plant_context, self.body.model_instance())[7:]

    def clearance(self, context: Context, reach: float) -> dict[str, float]:
        """Returns the distance of the object to each fixture that is within `reach` [m]."""
        query = self.diagram.GetOutputPort("query_object").Eval(context)
        inspector = query.inspector()
        own = self.body.model_instance()
        found: dict[str, float] = {}
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(reach):
            bodies = [
                self.plant.GetBodyFromFrameId(inspector.GetFrameId(g))
                for g in (pair.id_A, pair.id_B)
            ]
            others = [body for body in bodies if body.model_instance() != own]
            if len(others) != 1:
                continue
            name = self.plant.GetModelInstanceName(others[0].model_instance())
            found[name] = min(found.get(name, reach), pair.distance)
        return found


def _outputs(*systems: LeafSystem) -> dict:
    return {
        system.get_output_port(k).get_name(): system.get_output_port(k)
        for system in systems
        for k in range(system.num_output_ports())
    }


def _connect(builder: DiagramBuilder, system: LeafSystem, sources: dict) -> None:
    """Connects each input port to the output port of the same name."""
    for k in range(system.num_input_ports()):
        port = system.get_input_port(k)
        builder.Connect(sources[port.get_name()], port)
