"""One picture of each task: its demonstration, from blue to red."""

from pathlib import Path

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    RenderCameraCore,
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
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from poil_drake.benchmarks.control.arena.task import MODELS, ControlTask
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.demonstration import TaskDemonstration

_GHOSTS = 7
_WIDTH, _HEIGHT = 720, 540
_EYE, _LOOK_AT = np.array([-0.20, -0.70, 0.62]), np.array([0.52, 0.06, 0.16])
_FIELD_OF_VIEW = np.radians(42.0)


def DrawTask(name: str, path: Path) -> Path:
    """Draws a task as PNG: where the object is at even steps of its demonstration.

    Args:
        name: Of the task.
        path: Where the picture goes.
    """
    import cv2

    image = _render(MakeTask(name), TaskDemonstration(name).X_WO, TaskDemonstration(name).shape)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.ascontiguousarray(image[..., 2::-1]))
    return path


def _render(task: ControlTask, X_WO: np.ndarray, shape: np.ndarray) -> np.ndarray:
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
    for fixture in task.fixtures:
        (instance,) = parser.AddModels(str(MODELS / fixture.file))
        frame = plant.GetBodyByName(fixture.link, instance).body_frame()
        plant.WeldFrames(plant.world_frame(), frame, RigidTransform(np.array(fixture.position)))
    parser.SetAutoRenaming(True)
    steps = np.linspace(0, len(X_WO) - 1, _GHOSTS).round().astype(int)
    ghosts = [parser.AddModels(str(MODELS / task.object_file))[0] for _ in steps]
    plant.Finalize()
    for share, ghost in zip(np.linspace(0.0, 1.0, _GHOSTS), ghosts, strict=True):
        _paint(plant, scene_graph, ghost, Rgba(0.15 + 0.75 * share, 0.25, 0.9 - 0.75 * share, 1.0))
    core = RenderCameraCore(
        "vtk",
        CameraInfo(_WIDTH, _HEIGHT, _FIELD_OF_VIEW),
        ClippingRange(0.05, 5.0),
        RigidTransform(),
    )
    sensor = builder.AddSystem(
        RgbdSensor(
            scene_graph.world_frame_id(),
            _camera_pose(),
            ColorRenderCamera(core, False),
            DepthRenderCamera(core, DepthRange(0.05, 5.0)),
        )
    )
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    for step, ghost in zip(steps, ghosts, strict=True):
        q = plant.GetPositions(plant_context, ghost)
        q[7:] = shape
        plant.SetPositions(plant_context, ghost, q)
        body = plant.get_body(plant.GetBodyIndices(ghost)[0])
        plant.SetFreeBodyPose(plant_context, body, RigidTransform(X_WO[step]))
    image = sensor.color_image_output_port().Eval(sensor.GetMyContextFromRoot(context))
    return np.array(image.data)


def _paint(
    plant: MultibodyPlant, scene_graph: SceneGraph, model: ModelInstanceIndex, color: Rgba
) -> None:
    """Gives all of a model one colour, but for meshes, which have their own."""
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
    """Returns X_WC of a camera at the eye: z ahead, x right, y down."""
    ahead = (_LOOK_AT - _EYE) / np.linalg.norm(_LOOK_AT - _EYE)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.column_stack([right, np.cross(ahead, right), ahead])
    return RigidTransform(RotationMatrix(R), _EYE)
