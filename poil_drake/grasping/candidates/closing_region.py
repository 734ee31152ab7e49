"""What lies between the fingers: thin walls, whole bodies, and how well they are held."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, make_transform, transform_points
from poil_drake.grasping.candidates.grasp_candidate import GraspSamplingConfig


class Grip(NamedTuple):
    """What a gripper would hold.

    Attributes:
        X_WG: (4, 4) gripper pose with what it holds in the middle [m, world].
        width: Extent of that along the closing axis [m].
        contact_points: (2, 3) where the fingers touch [m, world].
        alignment: Mean cosine between closing axis and surface normals at the contacts.
        points: Number of points between the pads.
    """

    X_WG: np.ndarray
    width: float
    contact_points: np.ndarray
    alignment: float
    points: int


def find_grips(
    seed: np.ndarray,
    closing_axis: np.ndarray,
    approach: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    config: GraspSamplingConfig,
) -> list[Grip]:
    """Finds what can be taken between the fingers at one place from one direction.

    The points in the finger's column at the seed give the edge that is met first along the
    approach: a rim, or the top of a body. Behind that edge, gaps in the points along the closing
    axis separate walls; every run of walls that holds the seed and fits into the hand is a grip.
    A wall of which only one face was seen is a run as well, a very thin one.

    Args:
        seed: (3,) a point on the surface [m, world].
        closing_axis: (3,) unit axis along which the fingers close.
        approach: (3,) unit direction of approach, orthogonal to it.
        points: (P, 3) the object [m, world].
        normals: (P, 3) surface normals up to their sign.
        config: Sizes and thresholds.
    """
    R_WG = np.stack([np.cross(closing_axis, approach), closing_axis, approach], axis=1)
    X_GW = inverse(make_transform(R_WG, seed))
    own = transform_points(X_GW, points)
    column = np.abs(own[:, 0]) < 0.5 * config.pad_width
    if np.count_nonzero(column) < config.min_points:
        return []
    own, column_normals = own[column], normals[column]
    found = _edge(own, config)
    if found is None:
        return []
    edge, center = found
    grips = []
    for depth in (*config.insertion_depths, *config.body_depths):
        held = own[:, 2] < edge + depth
        for run in _runs(own[held], center, config):
            width = np.ptp(own[held][run][:, 1])
            if width <= config.thin_wall and depth not in config.insertion_depths:
                continue
            alignment = _alignment(own[held][run], column_normals[held][run] @ closing_axis, config)
            if alignment >= np.cos(config.friction_angle):
                y = own[held][run][:, 1]
                grips.append(_grip(y, edge + depth, R_WG, seed, alignment, config))
    return grips


def _edge(own: np.ndarray, config: GraspSamplingConfig) -> tuple[float, float] | None:
    """Returns z at which a finger at the seed's wall meets the object first and y there, or None.

    A wall that leans against the approach drifts out of the column on its way to the edge, so the
    column is moved after it until the edge comes no nearer.

    Args:
        own: (K, 3) points of the finger's column in the seed's frame [m].
        config: Sizes and thresholds.
    """
    center, edge = 0.0, np.inf
    while True:
        wall = own[np.abs(own[:, 1] - center) < 0.5 * config.gap]
        if len(wall) < config.min_points:
            return None if np.isinf(edge) else (edge, center)
        found = _strip_edge(wall, config.pad_width)
        if found > edge - config.surface_noise:
            return min(found, edge), center
        edge = found
        center = float(np.median(wall[wall[:, 2] < edge + config.gap, 1]))


def _strip_edge(wall: np.ndarray, pad_width: float) -> float:
    """Returns the median of the edge over three strips, as it may cross the pad askew."""
    strips = np.linspace(-0.5, 0.5, 4) * pad_width
    firsts = [wall[(wall[:, 0] >= low) & (wall[:, 0] <= high), 2] for low, high in pairwise(strips)]
    return float(np.median([z.min() for z in firsts if z.size]))


def _runs(own: np.ndarray, center: float, config: GraspSamplingConfig) -> list[np.ndarray]:
    """Returns the runs of walls that hold the wall at y = `center` and fit into the hand.

    Args:
        own: (K, 3) points between the fingers in the seed's frame [m].
        center: Where the seed's wall is along the closing axis [m].
        config: Sizes and thresholds.

    Returns:
        The indices of each run's points, by increasing y.
    """
    if not len(own):
        return []
    order = np.argsort(own[:, 1], kind="stable")
    y = own[order, 1]
    breaks = np.flatnonzero(np.diff(y) > config.gap)
    starts, ends = np.r_[0, breaks + 1], np.r_[breaks + 1, len(y)]
    mine = int(np.searchsorted(ends, np.argmin(np.abs(y - center)), side="right"))
    widest = config.gripper.max_width - 2.0 * min(config.opening_clearances)
    return [
        order[start:end]
        for start in starts[: mine + 1]
        for end in ends[mine:]
        if end - start >= config.min_points and y[end - 1] - y[start] <= widest
    ]


def _alignment(own: np.ndarray, cosines: np.ndarray, config: GraspSamplingConfig) -> float:
    """Returns the mean |cos| between closing axis and normals at the worse of the two contacts.

    It is 0 where a contact lies at the pad's edge: such a grip slips off or turns the object.

    Args:
        own: (K, 3) points between the fingers, by increasing y [m].
        cosines: (K,) between closing axis and their normals.
        config: Sizes and thresholds.
    """
    y = own[:, 1]
    worst = 1.0
    for contact in (y > y[-1] - config.surface_noise, y < y[0] + config.surface_noise):
        if abs(own[contact, 0].mean()) > config.contact_offset:
            return 0.0
        worst = min(worst, float(np.abs(cosines[contact]).mean()))
    return worst


def _grip(
    y: np.ndarray,
    tip: float,
    R_WG: np.ndarray,
    seed: np.ndarray,
    alignment: float,
    config: GraspSamplingConfig,
) -> Grip:
    """Returns the grip on points at y (K,), increasing, in the seed's frame, with the tips at z."""
    X_WSeed = make_transform(R_WG, seed)
    low, high = y[0], y[-1]
    origin = np.array([0.0, 0.5 * (low + high), tip - config.gripper.tip_end])
    contact_z = tip - 0.5 * config.insertion_depths[0]
    contacts = np.array([[0.0, high, contact_z], [0.0, low, contact_z]])
    return Grip(
        make_transform(R_WG, transform_points(X_WSeed, origin)),
        float(high - low),
        transform_points(X_WSeed, contacts),
        alignment,
        len(y),
    )
