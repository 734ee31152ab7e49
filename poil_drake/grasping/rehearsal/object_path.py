"""How the grasped object will move: lifted, then led by the field to the end of the reference."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.rollout import rollout
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.geometry.point_cloud import PointCloud, voxel_downsample
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import make_transform, transform_points
from poil_drake.robots.collision import CollisionConfig, SceneCloud, cloud_clearance


@dataclass(frozen=True, kw_only=True)
class ObjectPathConfig:
    """How the object's motion is foreseen and where it may touch the scene.

    Attributes:
        field: The velocity field that will lead the object; the controller's own parameters.
        lift_height: The object is lifted this far before the field takes over [m]: off the table,
            and above low obstacles.
        lift_speed: Speed of the lift [m/s].
        time_step: Step of the simulated run [s].
        max_time: Longest run [s].
        max_angular_speed: The controller's limit [rad/s].
        max_linear_speed: The controller's limit [m/s].
        path_step: Largest motion of the object between the samples at which the arm is checked
            [m]. The object itself is checked at every step of the run.
        part_allowance: Object points this near to the functional part are not checked against the
            scene [m]: the part is meant to meet the fixture.
        goal_radius: Where the part's points are nearer than this to their goal [m], the object
            comes as near to the fixture as the task has it ...
        goal_margin: ... and must only keep this clearance [m].
        stray_points: This many points of the object may be too close before it counts: noise of
            the cameras leaves some points beside the surfaces.
        check_voxel: The object is thinned to one point per cube of this edge for the check [m].
    """

    field: BcsdmConfig = field(default_factory=BcsdmConfig)
    lift_height: float = 0.06
    lift_speed: float = 0.1
    time_step: float = 1.0 / 32.0
    max_time: float = 40.0
    max_angular_speed: float = 1.0
    max_linear_speed: float = 0.25
    path_step: float = 0.015
    part_allowance: float = 0.012
    goal_radius: float = 0.05
    goal_margin: float = 0.002
    stray_points: int = 3
    check_voxel: float = 0.005


@dataclass(frozen=True, eq=False)
class ObjectPath(SharedOnCopy):
    """The object's foreseen motion.

    Attributes:
        times: (T,) [s], from 0.
        X_W: (T, 4, 4) rigid motion of the object since the grasp, in the world.
        samples: (S,) indices of the samples at which the arm is checked, first and last included.
        lift_end: Index of the sample at which the lift ends.
        converged: Whether the run ended at the end of the reference.
        excess: Largest amount by which the object comes nearer to the scene than it may [m]; 0
            where it keeps its distance.
    """

    times: np.ndarray
    X_W: np.ndarray
    samples: np.ndarray
    lift_end: int
    converged: bool
    excess: float

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[int | str, ...]] = {
            "times": ("T",),
            "X_W": ("T", 4, 4),
            "samples": ("S",),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            array = frozen_array(value, name=f"ObjectPath.{name}", shape=shape, dtype=value.dtype)
            object.__setattr__(self, name, array)


def foresee_object_path(
    target_points: np.ndarray,
    reference: PointTrajectory,
    *,
    object_points: np.ndarray,
    part_points: np.ndarray,
    scene: SceneCloud,
    config: ObjectPathConfig,
    collision: CollisionConfig,
) -> ObjectPath:
    """Simulates the object under the field and checks the whole object against the scene.

    Args:
        target_points: (N, 3) the part's points before the grasp [m, world].
        reference: Their reference.
        object_points: (P, 3) the whole object before the grasp [m, world].
        part_points: (M, 3) its functional part [m, world].
        scene: What must not be touched, without the object.
        config: The field, the lift and what may touch.
        collision: Clearance that the object must keep elsewhere.
    """
    lift_steps = max(int(np.ceil(config.lift_height / config.lift_speed / config.time_step)), 1)
    lift = make_transform(
        np.eye(3), np.linspace(0.0, config.lift_height, lift_steps + 1)[:, None] * [0.0, 0.0, 1.0]
    )
    # The reference's own rigid shape, put where the points are: unlike measured points it can
    # reach the end exactly.
    body = reference.positions[0]
    start = transform_points(kabsch(body, target_points), body)
    run = rollout(
        transform_points(lift[-1], start),
        reference,
        config.field,
        config.time_step,
        config.max_time,
        max_angular_speed=config.max_angular_speed,
        max_linear_speed=config.max_linear_speed,
    )
    X_W = np.concatenate([lift[:-1], run.X_W @ lift[-1]])
    times = config.time_step * np.arange(len(X_W))
    thinned = voxel_downsample(PointCloud(object_points), config.check_voxel).points
    checked = _away_from(thinned, part_points, config.part_allowance)
    required = _required_clearance(X_W, start, reference, config, collision)
    return ObjectPath(
        times=times,
        X_W=X_W,
        samples=_spread_samples(X_W, object_points, config.path_step),
        lift_end=lift_steps,
        converged=run.converged,
        excess=_excess(checked, X_W, scene, required, lift_steps, config.stray_points),
    )


def _away_from(points: np.ndarray, part_points: np.ndarray, distance: float) -> np.ndarray:
    if not len(part_points):
        return points
    apart, _ = cKDTree(part_points).query(points)
    return points[apart > distance]


def _required_clearance(
    X_W: np.ndarray,
    target_points: np.ndarray,
    reference: PointTrajectory,
    config: ObjectPathConfig,
    collision: CollisionConfig,
) -> np.ndarray:
    """Returns the clearance (T,) that the object must keep at each step."""
    moved = transform_points(X_W, target_points)
    to_goal = np.linalg.norm(moved - reference.positions[-1], axis=-1).mean(axis=-1)
    return np.where(to_goal < config.goal_radius, config.goal_margin, collision.object_margin)


def _excess(
    points: np.ndarray,
    X_W: np.ndarray,
    scene: SceneCloud,
    required: np.ndarray,
    lift_steps: int,
    stray_points: int,
) -> float:
    if len(points) <= stray_points:
        return 0.0
    clearance = cloud_clearance(points, X_W, scene)
    # On the way up only what the object comes nearer to counts, not what it stands on.
    lift = clearance[:lift_steps]
    lift[lift >= clearance[0]] = np.inf
    near = np.partition(clearance, stray_points, axis=1)[:, stray_points]
    return float(np.max(required - near, initial=0.0))


def _spread_samples(X_W: np.ndarray, points: np.ndarray, step: float) -> np.ndarray:
    """Returns indices between which no point moves farther than about `step`."""
    moved = transform_points(X_W, _bounding_corners(points))
    chosen = [0]
    for k in range(1, len(X_W)):
        farthest = np.linalg.norm(moved[k] - moved[chosen[-1]], axis=-1).max()
        if farthest >= step or k == len(X_W) - 1:
            chosen.append(k)
    return np.array(chosen)


def _bounding_corners(points: np.ndarray) -> np.ndarray:
    low, high = points.min(axis=0), points.max(axis=0)
    return np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1).reshape(-1, 3)
