"""A collision-free way of the object to one of several places of the reference."""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from poil_drake.control.entry.entry_clearance import EntryStart
from poil_drake.control.entry.entry_model import EntryModel
from poil_drake.planning.path_shortening import EdgeChecker, round_corners, shorten_path
from poil_drake.planning.pose_vectors import PoseSpace, poses_of, same_side, vectors_of
from poil_drake.planning.rrt_connect import rrt_connect


@dataclass(frozen=True, kw_only=True)
class TransitConfig:
    """How a way is searched.

    Attributes:
        candidates: How many places of the reference are tried. With 16 over half a metre, the one
            just before the contact and one every 3 cm.
        max_edge: Longest edge of the search trees [m, of a point at the object's radius].
        goals: To how many of them a way is searched at random, the last of them drawn. More than
            one, as the object may be locked in at some of them, a ring on a rod for example.
        iterations: Rounds of tree growth for each. Counted, not timed, so that the outcome does
            not depend on the machine's speed.
        open_clearance: A place with this much clearance is open [m], easy to get to.
        shortcuts: Attempts to shorten a way found at random.
        smoothing: Length over which corners are rounded off where there is room [m].
        room: How far beyond the start, the reference and the scene the object's middle may go [m],
            besides its radius.
    """

    candidates: int = 16
    max_edge: float = 0.3
    goals: int = 4
    iterations: int = 400
    open_clearance: float = 0.03
    shortcuts: int = 30
    smoothing: float = 0.1
    room: float = 0.15


class Transit(NamedTuple):
    """A way to the reference.

    Attributes:
        poses: (K, 4, 4) X_WB from the start to the reference's at `sample`.
        sample: The sample of the reference where it ends.
    """

    poses: np.ndarray
    sample: int


def entry_candidates(model: EntryModel, start: EntryStart, count: int) -> np.ndarray:
    """Returns samples (C,) where the reference may be entered, the nearest to the start first.

    They are evenly spread over the length of the stretches that keep the margin, the last sample
    before contact included. If none does, over the whole reference: what is demanded of the way
    there is then what the reference itself keeps.

    Args:
        model: Object, scene and reference.
        start: Where the object is.
        count: How many, besides the last allowed one and the nearest.
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
    wanted = np.linspace(0.0, along[-1], count)
    distances = model.displacement(start.X_WB[None], model.poses[allowed])[0]
    nearest = allowed[np.argmin(distances)]
    chosen = np.unique(
        np.r_[allowed[np.searchsorted(along, wanted, side="right") - 1], allowed[-1], nearest]
    )
    return chosen[np.argsort(model.displacement(start.X_WB[None], model.poses[chosen])[0])]


def straight_transit(
    model: EntryModel, start: EntryStart, candidates: np.ndarray
) -> Transit | None:
    """Returns the first straight way that is free, None if none is.

    The nearest place of the whole reference comes last: after a push, an object that was about to
    arrive is led back by the shortest way, in the midst of contact.

    Args:
        model: Object, scene and reference.
        start: Where the object is.
        candidates: (C,) samples of the reference where the way may end, in the order tried.
    """
    edges = model.edges(start)
    nearest = int(np.argmin(model.displacement(start.X_WB[None], model.poses)[0]))
    for index in [*candidates.tolist(), nearest]:
        corners = vectors_of(np.stack([start.X_WB, model.poses[index]]), model.radius)
        if edges.is_free(*corners):
            return Transit(poses_of(edges.samples(*corners)), index)
    return None


def searched_transit(
    model: EntryModel,
    start: EntryStart,
    candidates: np.ndarray,
    config: TransitConfig,
    seed: int,
) -> Transit | None:
    """Returns a way found by RRT-Connect, shortened and rounded off; None if none was found.

    It is searched to one place after the other: the open ones first, the nearest before the others,
    then those with the most clearance. The last one is drawn from all others, so that with enough
    seeds every place is tried.

    Args:
        model: Object, scene and reference.
        start: Where it begins.
        candidates: (C,) samples of the reference where it may end.
        config: Effort.
        seed: Of the search.
    """
    X_goals = model.poses[candidates]
    room = np.floor(model.clearance(X_goals, config.open_clearance) / config.open_clearance * 4.0)
    apart = model.displacement(start.X_WB[None], X_goals)[0]
    edges = model.edges(start)
    first = vectors_of(start.X_WB[None], model.radius)[0]
    space = PoseSpace(*model.bounds(start, config.room), model.radius)
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
            max_edge=config.max_edge,
            iterations=config.iterations,
            seed=seed,
        )
        if found is not None:
            corners = _turned_evenly(same_side(found), edges)
            corners = shorten_path(corners, edges, config.shortcuts, rng)
            path = round_corners(
                corners, edges, width=config.smoothing, resolution=edges.resolution
            )
            return Transit(poses_of(path), int(candidates[goal]))
    return None


def _turned_evenly(corners: np.ndarray, edges: EdgeChecker) -> np.ndarray:
    """Returns the same positions with the turn from the first to the last spread evenly, if free.

    The search turns the object at random, which takes time and serves nothing where there is room.

    Args:
        corners: (K, 7) pose vectors, each on the side of the one before.
        edges: The check.
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
