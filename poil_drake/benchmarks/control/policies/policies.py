"""The policies that the control study compares, by name; two of them are Point-set BCSDM."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from poil_drake.benchmarks.control.arena.arena import ARENA, AddTaskPlant, PlaceModel
from poil_drake.benchmarks.control.arena.shape_surface import shape_surface
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.demonstration import (
    RECORDING_PERIOD,
    ReferenceAlong,
    TaskDeformation,
    TaskDemonstration,
    TaskReference,
)
from poil_drake.benchmarks.control.point_policy.network import PointPolicyConfig, TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.policy import PointPolicy
from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Observation, Policy
from poil_drake.benchmarks.control.policies.scripted import OpenLoopPolicy
from poil_drake.benchmarks.control.policies.se3_bcsdm import (
    PoseTrajectory,
    Se3BcsdmConfig,
    Se3BcsdmPolicy,
)
from poil_drake.control.entry.entry_clearance import EntryClearanceConfig
from poil_drake.control.entry.entry_monitor import EntryMonitorConfig, EntryState, safe_entry_step
from poil_drake.control.entry.safe_entry import SafeEntryConfig, SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import (
    BcsdmConfig,
    BcsdmOutput,
    BcsdmStatus,
    point_set_bcsdm,
)
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.geometry.scene_cloud import SceneCloud

_CLOUD_SPACING = 0.005  # [m], that of a depth camera at a distance of half a metre.

LEARNED = {
    "pp_1": PointPolicyConfig(translation_noise=0.0, rotation_noise=0.0, halt_probability=0.0),
    "pp_50": PointPolicyConfig(translation_noise=0.0, rotation_noise=0.0, halt_probability=0.0),
    "pp_50_noise": PointPolicyConfig(),
}
"""Settings of the learned policies, without and with noise on the observations."""


@dataclass(frozen=True, kw_only=True)
class PolicyRow:
    """A policy, which is a row of the study's table.

    Attributes:
        name: Name on the command line and in files.
        title: Name in tables and pictures.
        demonstrations: Number of demonstrations that the policy learns from.
        paper: Row of the paper's table to compare the policy with; empty if there is none.
    """

    name: str
    title: str
    demonstrations: int
    paper: str = ""


ROWS = (
    PolicyRow(name="open_loop", title="Open-loop replay", demonstrations=1),
    PolicyRow(name="se3_bcsdm", title="SE(3) BCSDM, pose known", demonstrations=1),
    PolicyRow(name="pp_1", title="Point Policy", demonstrations=1, paper="pp_1"),
    PolicyRow(name="pp_50", title="Point Policy", demonstrations=50, paper="pp_50"),
    PolicyRow(name="pp_50_noise", title="Point Policy, noise in training", demonstrations=50),
    PolicyRow(name="field", title="Point-set BCSDM", demonstrations=1, paper="ours"),
    PolicyRow(
        name="safe_entry", title="Point-set BCSDM, safe entry", demonstrations=1, paper="ours"
    ),
)
"""The policies, in the table's order."""

OURS = "safe_entry"
"""The policy that this package offers."""


class FieldPolicy(Policy):
    """Follows the field of POIL, which uses only the points.

    Args:
        reference: The demonstrated motion of the points.
        config: Parameters of the field.
    """

    def __init__(self, reference: PointTrajectory, config: BcsdmConfig):
        self._reference, self._config = reference, config

    def step(
        self, state: float | None, observation: Observation
    ) -> tuple[float | None, CommandedTwist]:
        """Returns the closest time on the reference [s] and the twist.

        If the points are lost, returns `state` unchanged and a zero twist.
        """
        output = point_set_bcsdm(
            observation.points,
            self._reference,
            self._config,
            observation.confidence,
            previous_tau=state,
        )
        tau = state if output.status is BcsdmStatus.LOST else output.tau
        return tau, _command(output)


class SafeEntryPolicy(Policy):
    """Follows a collision-free path onto the reference, and then the field of POIL.

    Args:
        planner: Planner for the reference, the scene and the object's shape.
        config: When to plan again.
    """

    def __init__(self, planner: SafeEntryPlanner, config: EntryMonitorConfig):
        self._planner, self._config = planner, config

    def start(self) -> EntryState:
        """Returns the state before the first plan."""
        return EntryState()

    def step(
        self, state: EntryState, observation: Observation
    ) -> tuple[EntryState, CommandedTwist]:
        """Returns the next state and the twist that follows the plan. It is zero without a plan."""
        entry = safe_entry_step(
            state,
            observation.points,
            observation.time,
            self._planner,
            self._config,
            observation.confidence,
        )
        return entry, _command(entry.output)

    def note(self, state: EntryState) -> str:
        """Returns the kind of the planned entry, the number of plans, and the monitor's status."""
        kind = "none" if state.plan is None else state.plan.kind.name.lower()
        return f"{kind}, {state.replans} plans, {state.status.name.lower()}"


def _command(output: BcsdmOutput | None) -> CommandedTwist:
    """Returns the field's twist; a zero twist for None or if the points are lost."""
    if output is None or output.status is BcsdmStatus.LOST:
        return CommandedTwist(np.zeros(6), np.zeros(3))
    return CommandedTwist(output.twist, output.centroid)


def MakePolicy(
    name: str, task: str, trained: TrainedPointPolicy | None = None, *, noise: float = 0.0
) -> Policy:
    """Returns a policy for a task.

    Args:
        name: Name of the policy, as in `ROWS`.
        task: Name of the task.
        trained: The network of a learned policy; None for other policies.
        noise: Standard deviation of the noise in each coordinate of the observed points [m].
    """
    makers: dict[str, Callable[[], Policy]] = {
        "open_loop": lambda: OpenLoopPolicy(
            TaskDemonstration(task).points,
            period=RECORDING_PERIOD,
            max_angular_speed=ARENA.max_angular_speed,
            max_linear_speed=ARENA.max_linear_speed,
        ),
        "se3_bcsdm": lambda: _se3_bcsdm(task),
        "field": lambda: FieldPolicy(TaskReference(task), field_config(task, noise)),
        "safe_entry": lambda: SafeEntryPolicy(
            EntryPlanner(task, noise), monitor_config(task, noise)
        ),
    }
    return PointPolicy(trained) if trained else makers[name]()


def field_config(task: str, noise: float) -> BcsdmConfig:
    """Returns the field's parameters for a task, such that noisy points are not outliers.

    The inlier distance is the sum of its default, `TaskDeformation`, and 3.4 standard deviations
    of the noise [m]. The noise shifts 99 % of the points by less than 3.4 standard deviations.
    """
    default = BcsdmConfig().inlier_distance
    limit = default + 3.4 * noise + TaskDeformation(task)
    return BcsdmConfig(inlier_distance=limit)


def monitor_config(task: str, noise: float) -> EntryMonitorConfig:
    """Returns the settings of safe entry, such that an object at the goal does not seem blocked.

    The error to expect at the goal is the root sum of squares of `TaskDeformation` and 1.6 standard
    deviations of the noise, the mean distance by which it shifts points [m]. The stall error is at
    least 1.5 times the error to expect.
    """
    expected = 1.5 * math.hypot(1.6 * noise, TaskDeformation(task))
    return EntryMonitorConfig(stall_error=max(EntryMonitorConfig().stall_error, expected))


@cache
def EntryPlanner(task: str, noise: float) -> SafeEntryPlanner:
    """Returns the safe-entry planner for a task, with point clouds of the scene and the object."""
    scene, body = TaskClouds(task)
    return SafeEntryPlanner(
        reference=TaskReference(task),
        scene=SceneCloud(scene, ground_height=0.0),
        object_cloud=body,
        object_points=TaskDemonstration(task).points[0],
        bcsdm=field_config(task, noise),
        config=SafeEntryConfig(clearance=EntryClearanceConfig(deformation=TaskDeformation(task))),
    )


def TaskClouds(task: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns points on the scene and on the object at the start of the demonstration.

    They lie on the collision geometries, `_CLOUD_SPACING` apart.

    Returns:
        scene: (P, 3) points on the fixtures, without the table [m, world].
        body: (Q, 3) points on the object [m, world].
    """
    made, shown = MakeTask(task), TaskDemonstration(task)
    builder = DiagramBuilder()
    plant, scene_graph, body = AddTaskPlant(builder, made)
    context = plant.GetMyMutableContextFromRoot(builder.Build().CreateDefaultContext())
    PlaceModel(plant, context, body, shown.X_WO[0], shown.shape)

    def cloud(model: ModelInstanceIndex) -> np.ndarray:
        inspector, points = scene_graph.model_inspector(), []
        for index in plant.GetBodyIndices(model):
            part = plant.get_body(index)
            X_WB = plant.EvalBodyPoseInWorld(context, part)
            for geometry in plant.GetCollisionGeometriesForBody(part):
                surface = shape_surface(inspector.GetShape(geometry), _CLOUD_SPACING).T
                points.append((X_WB @ (inspector.GetPoseInFrame(geometry) @ surface)).T)
        return np.concatenate(points)

    links = [fixture.link for fixture in made.fixtures if fixture.link != "table"]
    scene = [cloud(plant.GetBodyByName(link).model_instance()) for link in links]
    return np.concatenate([np.zeros((0, 3)), *scene]), cloud(body.model_instance())


def _se3_bcsdm(task: str) -> Se3BcsdmPolicy:
    """Returns the policy for a known pose. Its reference is made from six points on the object."""
    corners = 0.05 * np.concatenate([np.eye(3), -np.eye(3)])
    poses = TaskDemonstration(task).X_WO[:, None]
    reference = ReferenceAlong(task, transform_points(poses, corners[None])[:, 0])
    X_WO = kabsch(np.broadcast_to(corners, reference.positions.shape), reference.positions)
    return Se3BcsdmPolicy(PoseTrajectory.of(reference.times, X_WO), Se3BcsdmConfig())
