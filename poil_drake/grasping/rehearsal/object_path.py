"""Predicts the grasped object's motion: the lift, then the field's motion along the reference."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.rollout import rollout
from poil_drake.geometry.point_cloud import PointCloud, voxel_downsample
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import make_transform, transform_points
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.robots.collision import CollisionConfig
from poil_drake.transfer.matching import Matching

LIFT_HEIGHT = 0.06
"""The object is lifted this far before the field takes over [m], so that it clears the table and
low obstacles."""

PATH_STEP = 0.015
"""Largest motion of the object between the samples at which the arm is checked [m]. The object
itself is checked at every time step."""

_LIFT_SPEED = 0.1  # [m/s]
_TIME_STEP = 1.0 / 32.0  # [s]
_CHECK_VOXEL = 0.005  # [m] The object is thinned to one point per cube of this edge for the check.

_PART_ALLOWANCE = 0.012
"""Object points within this distance of the functional part are not checked against the scene [m],
because the part is meant to meet the fixture."""

_GOAL_RADIUS, _GOAL_MARGIN = 0.05, 0.002
"""Near the goal the task brings the object close to the fixture. While the part's points are on
average within the radius of their goal [m], the object only has to keep the margin [m]."""

_STRAY_POINTS = 3
"""This many of the object's points may be too close to the scene, because camera noise puts some
points beside the surfaces."""


@dataclass(frozen=True, kw_only=True)
class ObjectPathConfig:
    """How the object's motion is predicted.

    Attributes:
        field: The controller's velocity field, which will lead the object.
        max_time: Longest simulated motion along the field [s].
        max_angular_speed: The controller's limit on the angular speed [rad/s].
        max_linear_speed: The controller's limit on the linear speed [m/s].
    """

    field: BcsdmConfig = field(default_factory=BcsdmConfig)
    max_time: float = 40.0
    max_angular_speed: float = 1.0
    max_linear_speed: float = 0.25


@dataclass(frozen=True, eq=False)
class ObjectPath:
    """The object's predicted motion.

    Attributes:
        times: (T,) [s], from 0.
        X_W: (T, 4, 4) rigid motion of the object since the grasp, in the world: a point that is at
            p at the grasp is at X_W[t] p.
        samples: (S,) indices of the times at which the arm is checked, first and last included.
        lift_end: Index of the time at which the lift ends.
        converged: Whether the motion reaches the end of the reference.
        excess: Largest amount by which the object falls short of its required clearance to the
            scene [m]; 0 if it always keeps that clearance.
    """

    times: np.ndarray
    X_W: np.ndarray
    samples: np.ndarray
    lift_end: int
    converged: bool
    excess: float


def predict_object_path(
    matching: Matching,
    *,
    object_points: np.ndarray,
    part_points: np.ndarray,
    scene: SceneCloud,
    config: ObjectPathConfig,
    collision: CollisionConfig,
) -> ObjectPath:
    """Returns the motion of the object, lifted and then led by the field, and its clearance.

    Args:
        matching: The part's points before the grasp and their reference.
        object_points: (P, 3) the whole object before the grasp [m, world].
        part_points: (M, 3) its functional part [m, world].
        scene: The obstacles, without the object.
        config: The field and its limits.
        collision: Margins of the check. The object must keep `object_margin`, except near the goal.
    """
    lift_steps = max(int(np.ceil(LIFT_HEIGHT / _LIFT_SPEED / _TIME_STEP)), 1)
    lift = make_transform(
        np.eye(3), np.linspace(0.0, LIFT_HEIGHT, lift_steps + 1)[:, None] * [0.0, 0.0, 1.0]
    )
    # The reference's own rigid shape, aligned with the points: unlike measured points, it can
    # reach the end exactly.
    body = matching.reference.positions[0]
    start = transform_points(kabsch(body, matching.target_points), body)
    run = rollout(
        transform_points(lift[-1], start),
        matching.reference,
        config.field,
        _TIME_STEP,
        config.max_time,
        max_angular_speed=config.max_angular_speed,
        max_linear_speed=config.max_linear_speed,
    )
    X_W = np.concatenate([lift[:-1], run.X_W @ lift[-1]])
    checked = voxel_downsample(PointCloud(object_points), _CHECK_VOXEL).points
    if len(part_points):
        checked = checked[cKDTree(part_points).query(checked)[0] > _PART_ALLOWANCE]
    offsets = transform_points(X_W, start) - matching.reference.positions[-1]
    to_goal = np.linalg.norm(offsets, axis=-1).mean(axis=-1)
    required = np.where(to_goal < _GOAL_RADIUS, _GOAL_MARGIN, collision.object_margin)
    return ObjectPath(
        times=_TIME_STEP * np.arange(len(X_W)),
        X_W=X_W,
        samples=_spread_samples(X_W, object_points),
        lift_end=lift_steps,
        converged=run.converged,
        excess=_excess(
            scene.distance(transform_points(X_W, checked), collision.max_distance),
            required,
            lift_steps,
        ),
    )


def _excess(clearance: np.ndarray, required: np.ndarray, lift_steps: int) -> float:
    """Returns `ObjectPath.excess`, given clearances (T, P) of points and required ones (T,) [m].

    During the lift, the first `lift_steps`, only points closer than at the start count.
    """
    if clearance.shape[1] <= _STRAY_POINTS:
        return 0.0
    # The object starts on a surface.
    lift = clearance[:lift_steps]
    lift[lift >= clearance[0]] = np.inf
    near = np.partition(clearance, _STRAY_POINTS, axis=1)[:, _STRAY_POINTS]
    return float(np.max(required - near, initial=0.0))


def _spread_samples(X_W: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Returns indices of poses between which no point moves farther than about `PATH_STEP`."""
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1)
    moved = transform_points(X_W, corners.reshape(-1, 3))
    chosen = [0]
    for k in range(1, len(X_W)):
        farthest = np.linalg.norm(moved[k] - moved[chosen[-1]], axis=-1).max()
        if farthest >= PATH_STEP or k == len(X_W) - 1:
            chosen.append(k)
    return np.array(chosen)
