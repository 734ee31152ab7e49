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
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.visualization import ApplyVisualizationConfig

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station_models import MakeStillPlant
from poil_drake.systems.ik.measured_posture import MeasuredPosture

REAL_ROBOT_PATH = "/drake/real_robot"
"""Path of the real robot in Meshcat in a dry run."""

_SHADE = 0.3
"""Opacity of the real robot in a dry run."""


class HardwareView:
    """Shows a scenario's models with the robot as measured, without the object.

    In a dry run the rehearsing robot moves, and the real one is shown as well; a slider on the page
    fades it. Keep this object as long as the diagram: Drake does not own the plants.
    """

    def __init__(
        self,
        *,
        builder: DiagramBuilder,
        scenario: Scenario,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        meshcat: Meshcat,
        dry_run: bool,
    ):
        """Adds the systems to a builder that holds those of `AddPandaHardware`.

        Args:
            builder: Gets the systems.
            scenario: The models.
            plant: Holds them.
            scene_graph: Its scene graph.
            meshcat: Shows them.
            dry_run: Whether the robot only rehearses.
        """
        self._scenario, self._plant, self._scene_graph = scenario, plant, scene_graph
        self._shade_plant: MultibodyPlant | None = None
        self._add(builder, meshcat, dry_run)

    def _add(self, builder: DiagramBuilder, meshcat: Meshcat, dry_run: bool) -> None:
        """Shows the models; in a dry run also the real robot, translucent."""
        arm = builder.GetSubsystemByName("panda_status").GetOutputPort("position_measured")
        hand = builder.GetSubsystemByName("hand_status").GetOutputPort("width_measured")
        scene_graph = builder.AddNamedSystem("scene_graph", self._scene_graph)
        if dry_run:
            preview = builder.GetSubsystemByName("kinematic_robot")
            shown = (
                preview.GetOutputPort("position_measured"),
                preview.GetOutputPort("width_measured"),
            )
        else:
            shown = arm, hand
        # The pose of the object is unknown.
        model = self._plant.GetModelInstanceByName(self._scenario.poil.object)
        _hide(self._plant, scene_graph, [model])
        self._pose(builder, "posture", scene_graph, *shown)
        ApplyVisualizationConfig(
            self._scenario.visualization,
            builder,
            plant=self._plant,
            scene_graph=scene_graph,
            meshcat=meshcat,
        )
        if dry_run:
            MeshcatVisualizer.AddToBuilder(
                builder,
                self._real_robot_scene(builder, arm, hand),
                meshcat,
                MeshcatVisualizerParams(
                    prefix=REAL_ROBOT_PATH,
                    publish_period=self._scenario.visualization.publish_period,
                    enable_alpha_slider=True,
                    initial_alpha_slider_value=_SHADE,
                ),
            )

    def _pose(
        self,
        builder: DiagramBuilder,
        name: str,
        scene_graph: SceneGraph,
        arm: OutputPort,
        hand: OutputPort,
        plant: MultibodyPlant | None = None,
    ) -> None:
        """Poses the robot in a scene by two ports; other models keep their default poses."""
        plant = plant or self._plant
        robot = plant.GetModelInstanceByName(self._scenario.poil.robot)
        posture = builder.AddNamedSystem(name, MeasuredPosture(plant=plant, robot=robot))
        poses = builder.AddNamedSystem(f"{name}_poses", MultibodyPositionToGeometryPose(plant))
        builder.Connect(arm, posture.GetInputPort("position_measured"))
        builder.Connect(hand, posture.GetInputPort("width_measured"))
        builder.Connect(posture.get_output_port(), poses.get_input_port())
        pose_port = scene_graph.get_source_pose_port(plant.get_source_id())
        builder.Connect(poses.get_output_port(), pose_port)

    def _real_robot_scene(
        self, builder: DiagramBuilder, arm: OutputPort, hand: OutputPort
    ) -> SceneGraph:
        """Adds a second scene that holds only the robot as measured."""
        plant, scene_graph, _ = MakeStillPlant(self._scenario)
        robot = plant.GetModelInstanceByName(self._scenario.poil.robot)
        others = (ModelInstanceIndex(k) for k in range(plant.num_model_instances()))
        _hide(plant, scene_graph, [model for model in others if model != robot])
        self._shade_plant = plant  # Drake does not own it.
        builder.AddNamedSystem("real_robot_scene", scene_graph)
        self._pose(builder, "real_posture", scene_graph, arm, hand, plant)
        return scene_graph


def _hide(
    plant: MultibodyPlant, scene_graph: SceneGraph, models: Sequence[ModelInstanceIndex]
) -> None:
    """Removes some models from visualizers."""
    inspector = scene_graph.model_inspector()
    for model in models:
        for body in plant.GetBodyIndices(model):
            frame = plant.GetBodyFrameIdOrThrow(body)
            for role in (Role.kIllustration, Role.kProximity):
                for geometry in inspector.GetGeometries(frame, role):
                    scene_graph.RemoveRole(plant.get_source_id(), geometry, role)
