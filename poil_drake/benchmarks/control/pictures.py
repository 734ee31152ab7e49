"""The pictures of the control study: success by distance, paths, and the tasks."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
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
from poil_drake.benchmarks.control.arena.tasks import (
    MODELS,
    NEAR_HALF,
    TASKS,
    ControlTask,
    MakeTask,
)
from poil_drake.benchmarks.control.demonstration import RecordedDemonstration, TaskDemonstration
from poil_drake.benchmarks.control.policies.policies import OURS, ROWS
from poil_drake.benchmarks.control.table import wilson_interval
from poil_drake.benchmarks.control.trial import ControlTrial

_BIN = 0.08  # Width of a bin of distances [m].
_SHOWN_PATHS = 40

_GHOSTS = 7
_EYE, _LOOK_AT = np.array([-0.20, -0.70, 0.62]), np.array([0.52, 0.06, 0.16])

_Groups = dict[tuple[str, str], list[ControlTrial]]
"""Trials by task and policy, without trials in hard mode and trials without a start pose."""


def draw_pictures(trials: Sequence[ControlTrial], folder: Path) -> None:
    """Writes PNGs of the objects' paths and, if there are Far trials, of success by distance."""
    groups: _Groups = {}
    for trial in trials:
        group = groups.setdefault((trial.task, trial.policy), [])
        if trial.region != "hard" and np.isfinite(trial.distance):
            group.append(trial)
    tasks = [name for name in TASKS if any(trial.task == name for trial in trials)]
    if any(trial.region == "far" for trial in trials):
        _draw_distances(groups, tasks, folder / "control_distance.png")
    _draw_paths(groups, tasks, folder / "control_paths.png")


def success_by_distance(
    trials: Sequence[ControlTrial],
) -> list[tuple[float, float, tuple[float, float]]]:
    """Returns the rate of success, in bins of the start's distance from the Near region.

    Each bin is (middle [m], success rate, 95 % interval). The bin below 0 holds the Near starts.
    """
    bins: dict[int, list[bool]] = {}
    for trial in trials:
        k = -1 if trial.region == "near" else int(trial.distance / _BIN)
        bins.setdefault(k, []).append(trial.success)
    return [
        ((k + 0.5) * _BIN, float(np.mean(one)), wilson_interval(sum(one), len(one)))
        for k, one in sorted(bins.items())
    ]


def _draw_distances(groups: _Groups, tasks: Sequence[str], path: Path) -> None:
    figure = Figure(figsize=(3.6 * len(tasks), 3.4))
    axes = figure.subplots(1, len(tasks), sharey=True, squeeze=False)[0]
    for axis, task in zip(axes, tasks, strict=True):
        axis.axvspan(-_BIN, 0.0, color="0.9")
        for k, row in enumerate(ROWS):
            trials = groups.get((task, row.name))
            if not trials:
                continue
            middles, rates, intervals = zip(*success_by_distance(trials), strict=True)
            axis.errorbar(
                np.array(middles) + 0.004 * (k - 3),
                100 * np.array(rates),
                yerr=100 * np.abs(np.array(intervals).T - rates),
                label=f"{row.title} ({row.demonstrations} demo)",
                color=_COLORS[row.name],
                marker="o",
                markersize=4,
                linewidth=2.0 if row.name == OURS else 1.2,
                capsize=2,
            )
        axis.set_title(MakeTask(task).title)
        axis.set(xlabel="distance to the Near region [m]", ylim=(-3, 103))
        axis.set_xticks([-0.5 * _BIN, 0.1, 0.2, 0.3, 0.4], ["Near", "0.1", "0.2", "0.3", "0.4"])
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("success [%]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3, frameon=False, fontsize=9)
    figure.tight_layout(rect=(0, 0.16, 1, 1))
    figure.savefig(path, dpi=110)


def _draw_paths(groups: _Groups, tasks: Sequence[str], path: Path) -> None:
    """Draws some paths in a top view, with a row for each task and a column for each policy."""
    rows = [row for row in ROWS if any(policy == row.name for _, policy in groups)]
    figure = Figure(figsize=(2.7 * len(rows), 2.7 * len(tasks)))
    axes = figure.subplots(len(tasks), len(rows), squeeze=False, sharex="row", sharey="row")
    for number, (line, task) in enumerate(zip(axes, tasks, strict=True)):
        for axis, row in zip(line, rows, strict=True):
            _draw_task_paths(axis, task, groups.get((task, row.name), []))
            if number == 0:
                title = row.title.replace(", ", ",\n")
                axis.set_title(f"{title}\n({row.demonstrations} demo)", fontsize=9)
        line[0].set_ylabel(f"{MakeTask(task).title}\ny [m]", fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel("x [m]", fontsize=9)
    handles = [Line2D([], [], color=color, label=label) for label, color in _PATHS.items()]
    for style, label in (
        ({"linestyle": "--"}, "demonstration"),
        ({"linestyle": "none", "marker": "*", "markersize": 8}, "its goal"),
        ({"linestyle": ":"}, "Near region"),
    ):
        handles.append(Line2D([], [], color="black", label=label, **style))
    figure.legend(handles=handles, loc="lower center", ncols=6, frameon=False, fontsize=9)
    figure.tight_layout(rect=(0, 0.03, 1, 1))
    figure.savefig(path, dpi=110)


def _draw_task_paths(axis: Axes, task: str, trials: Sequence[ControlTrial]) -> None:
    made = MakeTask(task)
    corner = made.start[:2, 3] - NEAR_HALF
    axis.add_patch(Rectangle(corner, 2 * NEAR_HALF[0], 2 * NEAR_HALF[1], fill=False, ls=":"))
    far = [trial for trial in trials if trial.region == "far"][:_SHOWN_PATHS]
    near = [trial for trial in trials if trial.region == "near"][: _SHOWN_PATHS // 4]
    for trial in [*far, *near]:
        outcome = "failed"
        if trial.success:
            outcome = "arrived" if trial.collision_free else "arrived after a collision"
        axis.plot(*trial.path[:, :2].T, color=_PATHS[outcome], alpha=0.45, linewidth=0.8)
    axis.plot(*made.keyframes[:, :2, 3].T, color="black", linewidth=1.0, linestyle="--")
    axis.plot(*made.keyframes[-1, :2, 3], marker="*", color="black", markersize=8)
    axis.set_aspect("equal")
    axis.tick_params(labelsize=7)


_COLORS = {
    "open_loop": "tab:gray",
    "se3_bcsdm": "tab:green",
    "pp_1": "tab:pink",
    "pp_50": "tab:red",
    "pp_50_noise": "tab:orange",
    "field": "tab:cyan",
    "safe_entry": "tab:blue",
}

_PATHS = {"arrived": "tab:blue", "arrived after a collision": "tab:orange", "failed": "tab:red"}


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
