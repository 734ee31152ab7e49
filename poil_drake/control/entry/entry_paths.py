"""Collision-free paths of the object onto the reference: by the field, straight, or searched."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from poil_drake.control.entry.entry_clearance import EntryStart
from poil_drake.control.entry.entry_model import EntryModel
from poil_drake.control.field.point_set_bcsdm import (
    BcsdmConfig,
    BcsdmOutput,
    BcsdmStatus,
    point_set_bcsdm,
)
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import moved_by_twist, transform_points
from poil_drake.planning.path_shortening import EdgeChecker, round_corners, shorten_path
from poil_drake.planning.rrt_connect import PoseSpace, poses_of, rrt_connect, same_side, vectors_of

# The field depends on the pose alone, so a speed limit that keeps the field's direction does not
# change the path, and steps may be long where the path is nearly straight.
_STEP_LENGTH = 0.01
"""Largest motion of a point of the object in a step [m]."""

_STEP_TIME = 0.1
"""Longest step [s]; with eta = 3 / s it removes a third of the error."""

_CONTACT_TUBE = 0.04
"""Where the reference is in contact, a rollout is clear only if no point of the object is farther
from the reference than this [m]. Clouds in contact do not show whether a loop is around a rod or
below it, or whether the rod bends a strap; only the path does."""

_JOINED = 0.002
"""The object has joined the reference once none of its points is farther from it than this [m]."""

_MAX_STEPS = 300
"""Enough for 2 m of path and the time to converge. A field that has not joined the reference by
then, for example close to a saddle, does not count as clear."""

_BATCH = 12
"""Number of steps between two checks for collisions."""

_CANDIDATES = 16
"""Number of samples of the reference to try: one every 3 cm for a path of half a metre."""

_MAX_EDGE = 0.3
"""Longest edge of the search trees [m, of a point at the object's radius]."""

_OPEN_CLEARANCE = 0.03
"""A goal with at least this clearance is open, that is, easy to reach [m]."""

_SHORTCUTS = 30
"""Attempts to shorten a path that the search found."""

_SMOOTHING = 0.1
"""Length over which corners are rounded, if there is room [m]."""

_ROOM = 0.15
"""Space for the object around the start, the reference and the scene [m]."""


@dataclass(frozen=True, kw_only=True)
class TransitConfig:
    """Effort of the search for a path.

    Attributes:
        goals: Number of samples to search a path to; the last one is drawn at random. Several are
            tried because the object may be trapped at some of them, like a ring on a rod.
        iterations: Largest number of rounds of tree growth for each goal.
    """

    goals: int = 4
    iterations: int = 400


def roll_out_entry(
    model: EntryModel,
    start: EntryStart,
    reference: PointTrajectory,
    field: BcsdmConfig,
    *,
    tau: float | None = None,
) -> np.ndarray | None:
    """Returns the object's path (K, 4, 4) under the field until it joins the reference.

    The result is None if the object collides, leaves a part of the reference that is in contact
    with the scene, or does not join the reference.

    Args:
        model: Object and scene.
        start: Pose of the object.
        reference: The reference that the field follows.
        field: Parameters of the field.
        tau: Time of the last closest configuration, for the progress window [s].
    """
    X = start.X_WB
    poses: list[np.ndarray] = []
    checked = 0
    for _ in range(_MAX_STEPS):
        poses.append(X)
        points = transform_points(X, model.points)
        output = point_set_bcsdm(points, reference, field, previous_tau=tau)
        if output.status is BcsdmStatus.LOST:
            return None
        tau = output.tau
        X_target = kabsch(model.points, output.target_points)
        apart = float(model.displacement(X[None], X_target[None])[0, 0])
        if reference.times[-1] - tau <= model.contact_left and apart > _CONTACT_TUBE:
            return None
        joined = output.status is BcsdmStatus.GOAL or max(output.mean_error, apart) < _JOINED
        if joined or len(poses) - checked >= _BATCH:
            if not model.is_free(np.array(poses[checked:]), start).all():
                return None
            checked = len(poses)
        if joined:
            return np.array(poses)
        X = _step(X, output, model.radius)
    return None


def _step(X: np.ndarray, output: BcsdmOutput, radius: float) -> np.ndarray:
    """Returns the next pose: the body turns about the centroid, and the centroid moves straight."""
    omega, arm = output.omega, X[:3, 3] - output.centroid
    speed = float(np.linalg.norm(output.v + np.cross(omega, arm)) + radius * np.linalg.norm(omega))
    duration = min(_STEP_TIME, _STEP_LENGTH / max(speed, 1e-9))
    return moved_by_twist(X, output.twist, output.centroid, duration)


def entry_candidates(model: EntryModel, start: EntryStart) -> np.ndarray:
    """Returns samples (C,) at which the reference may be entered, the nearest to the start first.

    The samples are spread evenly over the length of the stretches that keep the margin, and include
    the last and the nearest sample of these stretches. If no sample keeps the margin, they are
    spread over the whole reference; the path then only has to keep the reference's own clearance.

    Args:
        model: Object, scene and reference.
        start: Pose of the object.
    """
    (allowed,) = np.nonzero(model.free)
    if allowed.size == 0:
        allowed = np.arange(len(model.poses))
    steps = np.zeros(len(allowed))
    for k in range(1, len(allowed)):
        if allowed[k] == allowed[k - 1] + 1:
            X = model.poses[allowed[k - 1 : k + 1]]
            steps[k] = model.displacement(X[:1], X[1:])[0, 0]
    along = np.cumsum(steps)
    even = np.linspace(0.0, along[-1], _CANDIDATES)
    distances = model.displacement(start.X_WB[None], model.poses)[0]
    nearest = allowed[np.argmin(distances[allowed])]
    chosen = np.unique(
        np.r_[allowed[np.searchsorted(along, even, side="right") - 1], allowed[-1], nearest]
    )
    return chosen[np.argsort(distances[chosen])]


def straight_transit(
    model: EntryModel, start: EntryStart, candidates: np.ndarray
) -> tuple[np.ndarray, int] | None:
    """Returns the first straight path to the reference that is free; None if no path is free.

    The nearest sample of the whole reference is tried last. An object that was pushed just before
    its arrival thus returns by the shortest path, even in contact.

    Args:
        model: Object, scene and reference.
        start: Pose of the object.
        candidates: (C,) samples at which the path may end, in the order in which they are tried.

    Returns:
        Poses X_WB (K, 4, 4) on the path, and the sample of the reference at which it ends.
    """
    edges = model.edges(start)
    nearest = int(np.argmin(model.displacement(start.X_WB[None], model.poses)[0]))
    for index in [*candidates.tolist(), nearest]:
        corners = vectors_of(np.stack([start.X_WB, model.poses[index]]), model.radius)
        if edges.is_free(*corners):
            return poses_of(edges.samples(*corners)), index
    return None


def searched_transit(
    model: EntryModel,
    start: EntryStart,
    candidates: np.ndarray,
    config: TransitConfig,
    seed: int,
) -> tuple[np.ndarray, int] | None:
    """Returns a path found by RRT-Connect, shortened and with rounded corners; None without one.

    Goals with more clearance are tried first, and the nearest first among equals. Clearances are
    rounded down to multiples of 7.5 mm, up to 3 cm. The last goal is drawn at random from the other
    candidates, so that every candidate is tried with some seed.

    Args:
        model: Object, scene and reference.
        start: Pose of the object.
        candidates: (C,) samples at which the path may end.
        config: Effort of the search.
        seed: Seed of the search.

    Returns:
        See `straight_transit`.
    """
    X_goals = model.poses[candidates]
    room = np.floor(model.clearance(X_goals, _OPEN_CLEARANCE) / _OPEN_CLEARANCE * 4.0)
    apart = model.displacement(start.X_WB[None], X_goals)[0]
    edges = model.edges(start)
    first = vectors_of(start.X_WB[None], model.radius)[0]
    space = PoseSpace(*model.bounds(start, _ROOM), model.radius)
    order = np.lexsort([apart, -room])
    best, others = order[: config.goals - 1], order[config.goals - 1 :]
    rng = np.random.default_rng(seed)
    for goal in [*best, *rng.permutation(others)[:1]]:
        found = rrt_connect(
            space,
            first,
            vectors_of(X_goals[goal, None], model.radius)[0],
            is_free=lambda vectors: model.is_free(poses_of(vectors), start),
            edge_is_free=lambda a, b: edges.is_free(*same_side(np.stack([a, b]))),
            max_edge=_MAX_EDGE,
            iterations=config.iterations,
            seed=seed,
        )
        if found is not None:
            corners = _turned_evenly(same_side(found), edges)
            corners = shorten_path(corners, edges, _SHORTCUTS, rng)
            path = round_corners(corners, edges, width=_SMOOTHING)
            return poses_of(path), int(candidates[goal])
    return None


def _turned_evenly(corners: np.ndarray, edges: EdgeChecker) -> np.ndarray:
    """Returns a path with its rotation spread evenly over its length, or unchanged if not free.

    Args:
        corners: (K, 7) pose vectors with signs as in `same_side`.
        edges: The check of edges.
    """
    lengths = np.linalg.norm(np.diff(corners[:, :3], axis=0), axis=1)
    if not lengths.sum() > 0.0:
        return corners
    share = np.concatenate([[0.0], np.cumsum(lengths)])[:, None] / lengths.sum()
    first, last = same_side(corners[[0, -1]])
    even = corners.copy()
    even[:, 3:] = (1.0 - share) * first[3:] + share * last[3:]
    even[:, 3:] *= (np.linalg.norm(first[3:]) / np.linalg.norm(even[:, 3:], axis=1))[:, None]
    return even if all(edges.is_free(a, b) for a, b in pairwise(even)) else corners
