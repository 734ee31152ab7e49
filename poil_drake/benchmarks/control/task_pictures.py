"""Pictures of the tasks: each shows a demonstration, from blue to red."""

from pathlib import Path

import cv2
import numpy as np
from pydrake.geometry import (
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    RenderEngineVtkParams,
    Rgba,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraConfig, RgbdSensor

from poil_drake.benchmarks.control.arena.arena import AddFixtures, PlaceModel
from poil_drake.benchmarks.control.arena.task import MODELS, ControlTask
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.demonstration import RecordedDemonstration, TaskDemonstration

_GHOSTS = 7
_EYE, _LOOK_AT = np.array([-0.20, -0.70, 0.62]), np.array([0.52, 0.06, 0.16])


def DrawTask(name: str, path: Path) -> None:
    """Writes a PNG of a task: the object at evenly spaced times of its demonstration.

    Raises:
        RuntimeError: if VTK cannot render.
    """
    image = _render(MakeTask(name), TaskDemonstration(name))
    cv2.imwrite(str(path), np.ascontiguousarray(image[..., 2::-1]))


def _render(task: ControlTask, shown: RecordedDemonstration) -> np.ndarray:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.01)
    light = LightParameter(
        type="directional", frame="world", direction=[0.4, 0.6, -1], intensity=0.9
    )
    fill = LightParameter(type="directional", frame="camera", direction=[0, 0, 1], intensity=0.45)
    params = RenderEngineVtkParams(
        backend="EGL", default_clear_color=[1.0, 1.0, 1.0], lights=[light, fill]
    )
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(params))
    parser = Parser(plant)
    AddFixtures(plant, parser, task)
    parser.SetAutoRenaming(True)
    steps = np.linspace(0, len(shown.X_WO) - 1, _GHOSTS).round().astype(int)
    ghosts = [parser.AddModels(str(MODELS / task.object_file))[0] for _ in steps]
    plant.Finalize()
    for share, ghost in zip(np.linspace(0.0, 1.0, _GHOSTS), ghosts, strict=True):
        _paint(plant, scene_graph, ghost, Rgba(0.15 + 0.75 * share, 0.25, 0.9 - 0.75 * share, 1.0))
    camera = CameraConfig(
        width=720,
        height=540,
        focal=CameraConfig.FovDegrees(y=42.0),
        clipping_near=0.05,
        clipping_far=5.0,
        renderer_name="vtk",
    )
    sensor = builder.AddSystem(
        RgbdSensor(scene_graph.world_frame_id(), _camera_pose(), *camera.MakeCameras())
    )
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    for step, ghost in zip(steps, ghosts, strict=True):
        body = plant.get_body(plant.GetBodyIndices(ghost)[0])
        PlaceModel(plant, plant_context, body, shown.X_WO[step], shown.shape)
    image = sensor.color_image_output_port().Eval(sensor.GetMyContextFromRoot(context))
    return np.array(image.data)


def _paint(
    plant: MultibodyPlant, scene_graph: SceneGraph, model: ModelInstanceIndex, color: Rgba
) -> None:
    """Gives a model one colour, except for its meshes, which keep their own."""
    inspector = scene_graph.model_inspector()
    for index in plant.GetBodyIndices(model):
        frame = plant.GetBodyFrameIdOrThrow(index)
        for geometry in inspector.GetGeometries(frame, Role.kPerception):
            if isinstance(inspector.GetShape(geometry), Mesh):
                continue
            properties = PerceptionProperties(inspector.GetPerceptionProperties(geometry))
            properties.UpdateProperty("phong", "diffuse", color)
            if properties.HasProperty("phong", "diffuse_map"):
                properties.RemoveProperty("phong", "diffuse_map")
            scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kPerception)
            scene_graph.AssignRole(plant.get_source_id(), geometry, properties)


def _camera_pose() -> RigidTransform:
    """Returns X_WC of the camera: z forward, x right, y down."""
    ahead = (_LOOK_AT - _EYE) / np.linalg.norm(_LOOK_AT - _EYE)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.column_stack([right, np.cross(ahead, right), ahead])
    return RigidTransform(RotationMatrix(R), _EYE)
