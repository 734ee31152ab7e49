"""Shows a real robot in Meshcat."""

from collections.abc import Sequence

from pydrake.geometry import (
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Role,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.visualization import ApplyVisualizationConfig

from poil_drake.diagrams.scenario.model_parts import ModelBodies
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station_models import MakeUnsimulatedPlant
from poil_drake.systems.ik.measured_posture import MeasuredPosture

REAL_ROBOT_PATH = "/drake/real_robot"
"""Meshcat path of the real robot in a dry run."""

_SHADE = 0.3
"""Initial opacity of the real robot in a dry run."""


def AddHardwareView(
    *,
    builder: DiagramBuilder,
    scenario: Scenario,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    meshcat: Meshcat,
    dry_run: bool,
) -> MultibodyPlant | None:
    """Shows a scenario's models, except the object, with the robot in its measured posture.

    In a dry run, the measured posture is that of the `KinematicRobot`. The real robot is then shown
    as well, translucent. A slider in Meshcat sets the real robot's opacity.

    Args:
        builder: Receives the systems; must already hold the systems of `AddPandaHardware`.
        scenario: Names the models.
        plant: Holds the models.
        scene_graph: The plant's scene graph.
        meshcat: Shows the models.
        dry_run: Whether nothing is sent to the robot.

    Returns:
        In a dry run, the plant that shows the real robot, else None. Keep this plant and `plant` as
        long as the diagram, which owns neither plant.
    """
    robot = scenario.poil.robot
    arm = builder.GetSubsystemByName("panda_status").GetOutputPort("position_measured")
    hand = builder.GetSubsystemByName("hand_status").GetOutputPort("width_measured")
    shown = arm, hand
    if dry_run:
        preview = builder.GetSubsystemByName("kinematic_robot")
        ports = ("position_measured", "width_measured")
        shown = tuple(preview.GetOutputPort(port) for port in ports)
    builder.AddNamedSystem("scene_graph", scene_graph)
    # The pose of the object is unknown.
    _hide(plant, scene_graph, ModelBodies(plant, scenario.poil.object))
    _pose(builder, "posture", plant, scene_graph, robot, *shown)
    ApplyVisualizationConfig(
        scenario.visualization, builder, plant=plant, scene_graph=scene_graph, meshcat=meshcat
    )
    if not dry_run:
        return None
    real_plant, real_scene_graph, _ = MakeUnsimulatedPlant(scenario)
    shown_bodies = ModelBodies(real_plant, robot)
    others = (BodyIndex(k) for k in range(real_plant.num_bodies()))
    _hide(real_plant, real_scene_graph, [body for body in others if body not in shown_bodies])
    builder.AddNamedSystem("real_robot_scene", real_scene_graph)
    _pose(builder, "real_posture", real_plant, real_scene_graph, robot, arm, hand)
    MeshcatVisualizer.AddToBuilder(
        builder,
        real_scene_graph,
        meshcat,
        MeshcatVisualizerParams(
            prefix=REAL_ROBOT_PATH,
            publish_period=scenario.visualization.publish_period,
            enable_alpha_slider=True,
            initial_alpha_slider_value=_SHADE,
        ),
    )
    return real_plant


def _pose(
    builder: DiagramBuilder,
    name: str,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    robot: str,
    arm: OutputPort,
    hand: OutputPort,
) -> None:
    """Lets the ports `arm` and `hand` set the robot's posture in a scene; other models rest."""
    model = plant.GetModelInstanceByName(robot)
    posture = builder.AddNamedSystem(name, MeasuredPosture(plant=plant, robot=model))
    poses = builder.AddNamedSystem(f"{name}_poses", MultibodyPositionToGeometryPose(plant))
    builder.Connect(arm, posture.GetInputPort("position_measured"))
    builder.Connect(hand, posture.GetInputPort("width_measured"))
    builder.Connect(posture.get_output_port(), poses.get_input_port())
    pose_port = scene_graph.get_source_pose_port(plant.get_source_id())
    builder.Connect(poses.get_output_port(), pose_port)


def _hide(plant: MultibodyPlant, scene_graph: SceneGraph, bodies: Sequence[BodyIndex]) -> None:
    """Hides bodies from visualizers."""
    inspector = scene_graph.model_inspector()
    for body in bodies:
        frame = plant.GetBodyFrameIdOrThrow(body)
        for role in (Role.kIllustration, Role.kProximity):
            for geometry in inspector.GetGeometries(frame, role):
                scene_graph.RemoveRole(plant.get_source_id(), geometry, role)
