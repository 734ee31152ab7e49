"""The policies that the control study compares, by name."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from poil_drake.benchmarks.control.arena.arena import AddTaskPlant, ArenaConfig
from poil_drake.benchmarks.control.arena.surface_cloud import ModelCloud
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.demonstration import (
    RECORDING_PERIOD,
    ReferenceAlong,
    TaskDeformation,
    TaskDemonstration,
    TaskReference,
)
from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.policy import PointPolicy
from poil_drake.benchmarks.control.point_policy.trained import TrainedPointPolicy
from poil_drake.benchmarks.control.policies.entry_policy import SafeEntryPolicy
from poil_drake.benchmarks.control.policies.field_policy import FieldPolicy
from poil_drake.benchmarks.control.policies.open_loop import OpenLoopPolicy
from poil_drake.benchmarks.control.policies.policy import Policy
from poil_drake.benchmarks.control.policies.se3_bcsdm import Se3BcsdmPolicy
from poil_drake.control.entry.entry_clearance import EntryClearanceConfig
from poil_drake.control.entry.entry_monitor import EntryMonitorConfig
from poil_drake.control.entry.safe_entry import SafeEntryConfig, SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_consensus import RigidConsensusConfig
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.geometry.scene_distance import SceneDistance

CONTROL_PERIOD = 1 / 64
"""Of the analytic policies [s]."""

_CLOUD_SPACING = 0.005  # Of scene and object [m], a depth camera's at half a metre.

LEARNED = {
    "pp_1": PointPolicyConfig(translation_noise=0.0, rotation_noise=0.0, halt_probability=0.0),
    "pp_50": PointPolicyConfig(translation_noise=0.0, rotation_noise=0.0, halt_probability=0.0),
    "pp_50_noise": PointPolicyConfig(),
}
"""How the learned policies are trained: as published, and with noise on what they observe."""

Trained = Mapping[tuple[str, str], TrainedPointPolicy]
"""Trained policies by task and name."""


@dataclass(frozen=True, kw_only=True)
class PolicyRow:
    """A row of the table.

    Attributes:
        name: On the command line and in files.
        title: In tables and pictures.
        demonstrations: How many it learns from.
        paper: Which row of the paper's table it is compared with; empty for none.
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
"""The policies, in the table's order; the last is what this package offers."""

OURS = "safe_entry"


def MakePolicy(name: str, task: str, trained: Trained, *, noise: float = 0.0) -> Policy:
    """Returns a policy for a task.

    Args:
        name: Of a row.
        task: Name of the task.
        trained: Holds the learned policies that are needed.
        noise: Standard deviation of each coordinate of the points it will see [m].

    Raises:
        InvalidValueError: naming the policies that there are.
    """
    limits = ArenaConfig()
    makers: dict[str, Callable[[], Policy]] = {
        "open_loop": lambda: OpenLoopPolicy(
            TaskDemonstration(task).points,
            period=RECORDING_PERIOD,
            max_angular_speed=limits.max_angular_speed,
            max_linear_speed=limits.max_linear_speed,
        ),
        "se3_bcsdm": lambda: _se3_bcsdm(task),
        **{one: lambda: PointPolicy(trained[task, name]) for one in LEARNED},
        "field": lambda: FieldPolicy(
            TaskReference(task), config=field_config(task, noise), period=CONTROL_PERIOD
        ),
        "safe_entry": lambda: SafeEntryPolicy(
            EntryPlanner(task, noise), config=monitor_config(task, noise), period=CONTROL_PERIOD
        ),
    }
    if name not in makers:
        raise InvalidValueError(
            f"There is no policy '{name}'.", remedy=f"Choose from: {', '.join(makers)}."
        )
    return makers[name]()


def field_config(task: str, noise: float) -> BcsdmConfig:
    """Returns the field of a task: true points must not be taken for outliers.

    The limit is the default's, more by what noise of this standard deviation does to nearly every
    point (3.4 of them, for 99 % in three dimensions) and by how far the object deforms, as its
    demonstration shows.
    """
    default = RigidConsensusConfig().inlier_distance
    limit = default + 3.4 * noise + TaskDeformation(task)
    return BcsdmConfig(rigidity=RigidConsensusConfig(inlier_distance=limit))


def monitor_config(task: str, noise: float) -> EntryMonitorConfig:
    """Returns when safe entry plans again: an object that has arrived must not seem blocked.

    The mean distance of noisy points from where they belong is 1.6 standard deviations, to which
    deformation adds in squares; half as much again is to spare.
    """
    expected = 1.5 * math.hypot(1.6 * noise, TaskDeformation(task))
    return EntryMonitorConfig(stall_error=max(EntryMonitorConfig().stall_error, expected))


@cache
def EntryPlanner(task: str, noise: float) -> SafeEntryPlanner:
    """Returns what plans safe entries for a task, from clouds of scene and object."""
    scene, body = TaskClouds(task)
    return SafeEntryPlanner(
        reference=TaskReference(task),
        scene=SceneDistance(scene, ground_height=0.0),
        object_cloud=body,
        object_points=TaskDemonstration(task).points[0],
        bcsdm=field_config(task, noise),
        config=SafeEntryConfig(clearance=EntryClearanceConfig(deformation=TaskDeformation(task))),
    )


def TaskClouds(task: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns points on what stands around and on the object, when the demonstration starts.

    Returns:
        scene: (P, 3) [m, world], without the table.
        body: (Q, 3) [m, world].
    """
    made, shown = MakeTask(task), TaskDemonstration(task)
    builder = DiagramBuilder()
    plant, scene_graph, body = AddTaskPlant(builder, made, 1 / 128)
    context = plant.GetMyMutableContextFromRoot(builder.Build().CreateDefaultContext())
    q = plant.GetPositions(context, body.model_instance())
    q[7:] = shown.shape
    plant.SetPositions(context, body.model_instance(), q)
    plant.SetFreeBodyPose(context, body, RigidTransform(shown.X_WO[0]))

    def cloud(model: ModelInstanceIndex) -> np.ndarray:
        return ModelCloud(plant, context, scene_graph.model_inspector(), model, _CLOUD_SPACING)

    links = [fixture.link for fixture in made.fixtures if fixture.link != "table"]
    scene = [cloud(plant.GetBodyByName(link).model_instance()) for link in links]
    return np.concatenate([np.zeros((0, 3)), *scene]), cloud(body.model_instance())


def _se3_bcsdm(task: str) -> Se3BcsdmPolicy:
    """On the object's pose, along a reference made as that of the points is."""
    corners = 0.05 * np.concatenate([np.eye(3), -np.eye(3)])
    poses = TaskDemonstration(task).X_WO[:, None]
    reference = ReferenceAlong(task, transform_points(poses, corners[None])[:, 0])
    X_WO = kabsch(np.broadcast_to(corners, reference.positions.shape), reference.positions)
    return Se3BcsdmPolicy(
        times=reference.times, X_WO=X_WO, eta=BcsdmConfig().eta, period=CONTROL_PERIOD
    )
