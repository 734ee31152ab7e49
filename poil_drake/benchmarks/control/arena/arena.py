"""The simulation in which the control study tests all policies."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.geometry import DefaultProximityProperties, SceneGraph, SceneGraphConfig
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, OutputPort

from poil_drake.benchmarks.control.arena.contact_monitor import ContactMonitor
from poil_drake.benchmarks.control.arena.direct_actuation import (
    ActuationConfig,
    DirectActuation,
    Slip,
)
from poil_drake.benchmarks.control.arena.observation import DelayedTracking, PointObserver
from poil_drake.benchmarks.control.arena.tasks import MODELS, ControlTask
from poil_drake.benchmarks.control.policies.policy import Policy, PolicySystem

_MODULUS = 1e7  # [Pa], hard rubber: a force of 5 N indents boxes by micrometres, a rod by 3 mm.
_RESOLUTION = 0.01  # Of the meshes of round shapes [m].


@dataclass(frozen=True, kw_only=True)
class ArenaConfig:
    """The physics, which are the same for all policies.

    Attributes:
        time_step: Time step of the plant [s].
        max_angular_speed: Limit of the angular speed of commanded twists [rad/s].
        max_linear_speed: Limit of the linear speed of commanded twists [m/s].
        actuation: The hand that moves the object.
    """

    time_step: float = 1 / 128
    max_angular_speed: float = 2.0
    max_linear_speed: float = 0.25
    actuation: ActuationConfig = field(default_factory=ActuationConfig)


ARENA = ArenaConfig()


def AddTaskPlant(
    builder: DiagramBuilder, task: ControlTask
) -> tuple[MultibodyPlant, SceneGraph, RigidBody]:
    """Adds a plant with the task's object and fixtures.

    Gravity does not act on a rigid object; a deforming object hangs in the hand. Contact is
    hydroelastic: at a single contact point, two boxes could rotate into each other.

    Returns:
        The finalized plant, its scene graph, and the driven body.
    """
    config = MultibodyPlantConfig(
        time_step=ARENA.time_step,
        contact_model="hydroelastic_with_fallback",
        discrete_contact_approximation="lagged",
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    properties = DefaultProximityProperties(
        compliance_type="compliant", hydroelastic_modulus=_MODULUS, resolution_hint=_RESOLUTION
    )
    scene_graph.set_config(SceneGraphConfig(default_proximity_properties=properties))
    parser = Parser(plant)
    AddFixtures(plant, parser, task)
    (instance,) = parser.AddModels(str(MODELS / task.object_file))
    if task.rigid:
        plant.set_gravity_enabled(instance, False)
    plant.Finalize()
    return plant, scene_graph, plant.get_body(plant.GetBodyIndices(instance)[0])


def AddFixtures(plant: MultibodyPlant, parser: Parser, task: ControlTask) -> None:
    """Adds the task's fixtures, welded to the world."""
    for fixture in task.fixtures:
        (instance,) = parser.AddModels(str(MODELS / fixture.file))
        frame = plant.GetBodyByName(fixture.link, instance).body_frame()
        plant.WeldFrames(plant.world_frame(), frame, RigidTransform(np.array(fixture.position)))


def PlaceModel(
    plant: MultibodyPlant, context: Context, body: RigidBody, X_WO: np.ndarray, shape: np.ndarray
) -> None:
    """Sets the positions of a free-floating model.

    Args:
        plant: The plant.
        context: The plant's context.
        body: The model's first body.
        X_WO: (4, 4) pose of `body`.
        shape: Positions of the model's joints.
    """
    q = plant.GetPositions(context, body.model_instance())
    q[7:] = shape
    plant.SetPositions(context, body.model_instance(), q)
    plant.SetFreeBodyPose(context, body, RigidTransform(X_WO))


class Arena:
    """A diagram of plant, policy, hand, observer and contact monitor.

    Attributes:
        task: The task.
        diagram: The diagram.

    Args:
        task: The object, the scene and the demonstration.
        policy: The controller.
        intended_contact: The argument `intended` of `ContactMonitor`.
        tracker: Tracks the points for the policy; if None, the policy observes the true points.
    """

    def __init__(
        self,
        task: ControlTask,
        policy: Policy,
        *,
        intended_contact: np.ndarray | None = None,
        tracker: DelayedTracking | None = None,
    ):
        self.task, self._tracker = task, tracker
        builder = DiagramBuilder()
        self._plant, scene_graph, self._body = AddTaskPlant(builder, task)
        plant, n, model = self._plant, len(task.link_points), self._body.model_instance()
        self._observer = PointObserver(
            plant=plant,
            body=self._body,
            carriers=[plant.GetBodyByName(name, model) for name in task.carriers],
            p_BP=task.link_points,
        )
        self._policy = PolicySystem(
            policy=policy,
            num_points=n,
            max_angular_speed=ARENA.max_angular_speed,
            max_linear_speed=ARENA.max_linear_speed,
        )
        self._hand = DirectActuation(plant=plant, body=self._body, config=ARENA.actuation)
        self._monitor = ContactMonitor(
            plant=plant, body=self._body, num_points=n, intended=intended_contact
        )
        systems = [self._observer, self._policy, self._hand, self._monitor]
        for system in systems:
            builder.AddSystem(system)
        sources = _outputs(*systems) | {
            "body_poses": plant.get_body_poses_output_port(),
            "body_spatial_velocities": plant.get_body_spatial_velocities_output_port(),
            "contact_results": plant.get_contact_results_output_port(),
            "query_object": scene_graph.get_query_output_port(),
        }
        observed = sources
        if tracker is not None:
            builder.AddSystem(tracker)
            _connect(builder, tracker, sources)
            observed = sources | _outputs(tracker)
        for system in systems:
            _connect(builder, system, observed if system is self._policy else sources)
        builder.Connect(
            self._hand.GetOutputPort("applied_spatial_force"),
            plant.get_applied_spatial_force_input_port(),
        )
        builder.ExportOutput(scene_graph.get_query_output_port(), "query_object")
        self.diagram: Diagram = builder.Build()

    def points(self, context: Context) -> np.ndarray:
        """Returns the true points, (N, 3) [m, world]."""
        return _evaluate(self._observer, "points", context).reshape(-1, 3)

    def pose(self, context: Context) -> np.ndarray:
        """Returns X_WO (4, 4) of the driven body."""
        return _evaluate(self._observer, "object_pose", context).reshape(4, 4)

    def contact(self, context: Context) -> tuple[float, float]:
        """Returns total impulse [N s] and deepest penetration [m] of unintended contact so far."""
        impulse, depth = (_evaluate(self._monitor, name, context) for name in ("impulse", "depth"))
        return float(impulse[0]), float(depth[0])

    def note(self, context: Context) -> str:
        """Returns the policy's remark on its state."""
        return self._policy.GetNote(self._policy.GetMyContextFromRoot(context))

    def SetSlip(self, context: Context, slip: Slip) -> None:
        """Sets how the object will slip in the hand."""
        self._hand.SetSlip(self._hand.GetMyMutableContextFromRoot(context), slip)

    def SetNoiseSeed(self, context: Context, seed: int) -> None:
        """Seeds the tracker's noise, if there is a tracker."""
        if self._tracker is not None:
            self._tracker.SetSeed(self._tracker.GetMyMutableContextFromRoot(context), seed)

    def place(self, context: Context, X_WO: np.ndarray, shape: np.ndarray) -> None:
        """Places the object as `PlaceModel` does, but in the diagram's context."""
        plant_context = self._plant.GetMyMutableContextFromRoot(context)
        PlaceModel(self._plant, plant_context, self._body, X_WO, shape)

    def shape(self, context: Context) -> np.ndarray:
        """Returns the positions of the object's joints, without its pose."""
        plant_context = self._plant.GetMyContextFromRoot(context)
        return self._plant.GetPositions(plant_context, self._body.model_instance())[7:]

    def clearance(self, context: Context, reach: float) -> dict[str, float]:
        """Returns the distance from the object to each fixture within `reach` [m], by name."""
        query = self.diagram.GetOutputPort("query_object").Eval(context)
        inspector = query.inspector()
        distances: dict[str, float] = {}
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(reach):
            frames = [inspector.GetFrameId(geometry) for geometry in (pair.id_A, pair.id_B)]
            models = [self._plant.GetBodyFromFrameId(frame).model_instance() for frame in frames]
            others = [model for model in models if model != self._body.model_instance()]
            if len(others) == 1:
                name = self._plant.GetModelInstanceName(others[0])
                distances[name] = min(distances.get(name, reach), pair.distance)
        return distances


def _evaluate(system: LeafSystem, port: str, context: Context) -> np.ndarray:
    return system.GetOutputPort(port).Eval(system.GetMyContextFromRoot(context))


def _outputs(*systems: LeafSystem) -> dict[str, OutputPort]:
    ports = [s.get_output_port(k) for s in systems for k in range(s.num_output_ports())]
    return {port.get_name(): port for port in ports}


def _connect(builder: DiagramBuilder, system: LeafSystem, sources: dict[str, OutputPort]) -> None:
    """Connects each input port to the output port of the same name."""
    for k in range(system.num_input_ports()):
        port = system.get_input_port(k)
        builder.Connect(sources[port.get_name()], port)
