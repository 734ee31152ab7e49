"""Samples parallel-jaw grasps on a point cloud: on the rims of thin walls, and on whole bodies."""

from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.point_cloud import PointCloud, voxel_downsample
from poil_drake.grasping.candidates.closing_region import (
    FRICTION_COSINE,
    MIN_POINTS,
    OPENING_CLEARANCES,
    Grip,
    find_grips,
)
from poil_drake.grasping.candidates.diversity import (
    SAME_ANGLE,
    SAME_POSITION,
    dissimilar,
    keep_diverse,
)
from poil_drake.grasping.candidates.grasp_candidate import (
    GRIPPER,
    GraspCandidate,
    GraspSamplingConfig,
)
from poil_drake.grasping.candidates.grasp_scene import GraspScene
from poil_drake.runtime.worker_executor import run_in_halves

_CLOUD_VOXEL = 0.003  # [m] The object's cloud is thinned to one point per cube of this edge.
_SPINS = 16  # Approach directions tried about each closing axis, over the full turn.

_NORMAL_RADIUS = 0.010
"""Radius of the neighbourhood whose normal is a closing axis [m]. It is wide enough to contain both
faces of a thin, noisy wall, so that the normal is the wall's."""

_WIDE_APPROACH_ANGLE = 1.4
"""Largest angle between approach direction and straight down [rad] if steeper approaches yield
fewer than `_FEW_CANDIDATES` grasps. The rim of a mug that lies on its side faces sideways."""

_FEW_CANDIDATES = 16
_DOWN = np.array([0.0, 0.0, -1.0])


def sample_antipodal_grasps(
    object_cloud: PointCloud,
    part_points: np.ndarray,
    *,
    obstacle_points: np.ndarray | None = None,
    ground_height: float | None = 0.0,
    config: GraspSamplingConfig | None = None,
    seed: int = 0,
    executor: Executor | None = None,
) -> list[GraspCandidate]:
    """Samples antipodal grasps that approach roughly from above and leave the part free.

    Each of some random surface points gives up to two closing axes: the normal of `wall_normals`,
    and the normal in `object_cloud` if it differs. Approach directions are tried all around each
    axis. The surfaces between the fingers determine the grip (`find_grips`). The boxes of the open
    gripper must be clear of the object, the part, the obstacles and the table. Each grasp is
    returned twice, half a turn about the approach direction apart.

    Args:
        object_cloud: The whole object [m, world], with or without normals.
        part_points: (M, 3) its functional part [m, world].
        obstacle_points: (Q, 3) all other obstacles [m, world]; None for none.
        ground_height: Height of the table [m]; None without a table.
        config: Parameters; None for the defaults.
        seed: Seed for choosing the surface points.
        executor: Does half of the work; None: this process does all.

    Returns:
        The candidates, best first; empty if the object cannot be grasped.

    Raises:
        InvalidValueError: The cloud has too few points.
    """
    config = config or GraspSamplingConfig()
    object_cloud = voxel_downsample(object_cloud, _CLOUD_VOXEL)
    points = object_cloud.points
    if len(points) < MIN_POINTS:
        raise InvalidValueError(
            f"The object cloud has {len(points)} points; {MIN_POINTS} are needed.",
            remedy="Check the object's mask and depth, or move the cameras nearer to the object.",
        )
    scene = GraspScene(
        object_points=points,
        part_points=np.asarray(part_points, dtype=float).reshape(-1, 3),
        obstacle_points=np.zeros((0, 3)) if obstacle_points is None else obstacle_points,
        ground_height=ground_height,
        part_clearance=config.part_clearance,
    )
    normals = wall_normals(points, _NORMAL_RADIUS)
    axes: list[tuple[int, np.ndarray]] = []
    for index in _seed_indices(scene, config, seed):
        axes.append((index, normals[index]))
        if (
            object_cloud.normals is not None
            and abs(object_cloud.normals[index] @ normals[index]) < FRICTION_COSINE
        ):
            axes.append((index, object_cloud.normals[index]))
    found: list[GraspCandidate] = []
    for largest_angle in (config.approach_angle, _WIDE_APPROACH_ANGLE):
        find = partial(_grips, points=points, normals=normals, largest_angle=largest_angle)
        grips = _thinned(run_in_halves(find, axes, executor))
        found = run_in_halves(partial(_candidates, scene=scene, config=config), grips, executor)
        if len(found) >= _FEW_CANDIDATES:
            break
    return keep_diverse(found, points.mean(axis=0))


def wall_normals(points: np.ndarray, radius: float) -> np.ndarray:
    """Returns unit surface normals (P, 3), up to their sign, from each point's neighbourhood.

    A normal is the direction in which the neighbourhood extends least. The neighbourhood contains
    both faces of a wall thinner than the radius. The normal is then that of the wall, even if the
    faces are noisy.

    Args:
        points: (P, 3) the cloud [m].
        radius: Radius of the neighbourhood [m].
    """
    neighbours = cKDTree(points).query_ball_point(points, radius)
    counts = np.array([len(n) for n in neighbours])
    flat = np.concatenate([np.asarray(n, dtype=int) for n in neighbours])
    owner = np.repeat(np.arange(len(points)), counts)
    mean = np.stack(
        [np.bincount(owner, points[flat, k], minlength=len(points)) for k in range(3)], axis=1
    )
    centered = points[flat] - (mean / counts[:, None])[owner]
    covariance = np.empty((len(points), 3, 3))
    for i in range(3):
        for j in range(3):
            covariance[:, i, j] = np.bincount(
                owner, centered[:, i] * centered[:, j], minlength=len(points)
            )
    return np.linalg.eigh(covariance)[1][:, :, 0]


def approach_directions(closing_axis: np.ndarray, spins: int, largest_angle: float) -> np.ndarray:
    """Returns the approach directions (S, 3) orthogonal to a closing axis, steepest first.

    Args:
        closing_axis: (3,) unit axis along which the fingers close.
        spins: Number of directions tried over the full turn.
        largest_angle: Directions farther than this from straight down are left out [rad].
    """
    steepest = _DOWN - (_DOWN @ closing_axis) * closing_axis
    length = np.linalg.norm(steepest)
    if length < np.cos(largest_angle):
        return np.zeros((0, 3))
    steepest /= length
    angles = 2.0 * np.pi * np.arange(spins) / spins
    sideways = np.cross(closing_axis, steepest)
    directions = np.cos(angles)[:, None] * steepest + np.sin(angles)[:, None] * sideways
    cosines = directions @ _DOWN
    order = np.argsort(-np.round(cosines, 9), kind="stable")
    return directions[order[cosines[order] >= np.cos(largest_angle)]]


def _seed_indices(scene: GraspScene, config: GraspSamplingConfig, seed: int) -> np.ndarray:
    points = scene.object_points
    eligible = np.arange(len(points))
    if len(scene.part_points):
        distance, _ = cKDTree(scene.part_points).query(points)
        eligible = np.flatnonzero(distance > config.part_clearance)
    rng = np.random.default_rng(seed)
    count = min(config.seed_points, len(eligible))
    return rng.choice(eligible, size=count, replace=False)


def _grips(
    axes: Sequence[tuple[int, np.ndarray]],
    *,
    points: np.ndarray,
    normals: np.ndarray,
    largest_angle: float,
) -> list[Grip]:
    """Returns the grips for pairs of a point's index and a closing axis."""
    return [
        grip
        for index, axis in axes
        for approach in approach_directions(axis, _SPINS, largest_angle)
        for grip in find_grips(points[index], axis, approach, points, normals)
    ]


def _thinned(grips: list[Grip]) -> list[Grip]:
    """Returns the best grip of each group of nearly equal ones, so that fewer are checked."""
    if not grips:
        return []
    kept = dissimilar(
        np.array([grip.X_WG for grip in grips]),
        np.array([grip.alignment + grip.points / (8.0 * MIN_POINTS) for grip in grips]),
        0.5 * SAME_POSITION,
        0.5 * SAME_ANGLE,
    )
    return [grips[i] for i in kept]


def _candidates(
    grips: Sequence[Grip], *, scene: GraspScene, config: GraspSamplingConfig
) -> list[GraspCandidate]:
    """Returns two grasps, half a turn apart, for each grip that some opening fits.

    The opening is the widest that fits.
    """
    found = []
    for grip in grips:
        for clearance in OPENING_CLEARANCES:
            opening = grip.width + 2.0 * clearance
            if opening <= GRIPPER.max_width and scene.is_clear(grip.X_WG, opening):
                score = _score(grip, clearance, scene, config)
                turned = grip.X_WG @ np.diag([-1.0, -1.0, 1.0, 1.0])
                found += [
                    GraspCandidate(grip.X_WG, grip.width, opening, score, grip.contact_points),
                    GraspCandidate(turned, grip.width, opening, score, grip.contact_points[::-1]),
                ]
                break
    return found


def _score(grip: Grip, clearance: float, scene: GraspScene, config: GraspSamplingConfig) -> float:
    """Returns the mean of several measures of quality, each in [0, 1]."""
    floor = FRICTION_COSINE
    far_from_part = 1.0
    if len(scene.part_points):
        gap = np.linalg.norm(scene.part_points - grip.X_WG[:3, 3], axis=1).min()
        # Beyond half the hand's length, more distance does not help.
        far_from_part = min(gap / (0.5 * GRIPPER.hand_size[1]), 1.0)
    steepness, flattest = -grip.X_WG[2, 2], np.cos(config.approach_angle)
    terms = [
        (grip.alignment - floor) / (1.0 - floor),
        min(grip.points / (8.0 * MIN_POINTS), 1.0),
        far_from_part,
        clearance / max(OPENING_CLEARANCES),
        max((steepness - flattest) / (1.0 - flattest), 0.0),
    ]
    return float(np.clip(np.mean(terms), 0.0, 1.0))
