"""Finds the surfaces that the fingers can hold: the rims of thin walls, and whole bodies."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, make_transform, transform_points
from poil_drake.grasping.candidates.grasp_candidate import GRIPPER

FRICTION_COSINE = np.cos(0.4)
"""Smallest cosine of the angle between the closing axis and the surface normal at a contact. The
friction cone of a coefficient of 0.42 has a half-angle of 0.4 rad."""

MIN_POINTS = 8
"""Smallest number of points between the pads of a grip."""

OPENING_CLEARANCES = (0.012, 0.009, 0.006)
"""Gaps to try between each finger and the object before closing [m]; the largest that fits is used.
The gap absorbs the errors of cameras and arm."""

_INSERTION_DEPTHS = (0.016, 0.012)
"""How far the fingertips reach past the edge of a thin wall [m]. The pads are 18 mm long; less than
12 mm holds poorly, and more than 16 mm brings the hand near the edge."""

_BODY_DEPTHS = (0.036, 0.026)
"""How far the fingertips reach past the edge of a body that is wider than a thin wall [m]. Round
bodies are widest well below their top."""

_THIN_WALL = 0.015  # [m] Nothing wider than this is a thin wall.
_GAP = 0.009  # [m] Wider gaps in the points along the closing axis separate two walls.
_PAD_WIDTH = 0.018  # [m] Along x.
_CONTACT_OFFSET = 0.0026  # [m] Largest distance, along x, of a contact from the middle of the pad.

_SURFACE_NOISE = 0.003
"""Points this close to the outermost one along an axis belong to the same surface [m]: about three
standard deviations of a depth camera's noise."""


class Grip(NamedTuple):
    """Surfaces that a gripper can hold.

    Attributes:
        X_WG: (4, 4) gripper pose, centred on the surfaces [m, world].
        width: Extent of the surfaces along the closing axis [m].
        contact_points: (2, 3) the fingers' contacts [m, world].
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
) -> list[Grip]:
    """Returns the grips at one point of the surface for one approach direction.

    Points beside the pads do not count. Along the approach, the other points begin at an edge: a
    rim, or the top of a body. Behind this edge, gaps between the points along the closing axis
    separate walls. A run is one wall, or several neighbouring ones. Every run that contains the
    seed's wall and fits into the hand is a possible grip.

    Args:
        seed: (3,) a point on the surface [m, world].
        closing_axis: (3,) unit axis along which the fingers close.
        approach: (3,) unit direction of approach, orthogonal to the closing axis.
        points: (P, 3) the object [m, world].
        normals: (P, 3) surface normals up to their sign.
    """
    R_WG = np.stack([np.cross(closing_axis, approach), closing_axis, approach], axis=1)
    X_WSeed = make_transform(R_WG, seed)
    own = transform_points(inverse(X_WSeed), points)
    column = np.abs(own[:, 0]) < 0.5 * _PAD_WIDTH
    if np.count_nonzero(column) < MIN_POINTS:
        return []
    own, column_normals = own[column], normals[column]
    found = _edge(own)
    if found is None:
        return []
    edge, center = found
    grips = []
    for depth in (*_INSERTION_DEPTHS, *_BODY_DEPTHS):
        held = own[:, 2] < edge + depth
        for run in _runs(own[held], center):
            width = np.ptp(own[held][run][:, 1])
            if width <= _THIN_WALL and depth not in _INSERTION_DEPTHS:
                continue
            alignment = _alignment(own[held][run], column_normals[held][run] @ closing_axis)
            if alignment >= FRICTION_COSINE:
                y = own[held][run][:, 1]
                grips.append(_grip(y, edge + depth, X_WSeed, alignment))
    return grips


def _edge(own: np.ndarray) -> tuple[float, float] | None:
    """Returns z and y of the edge at which the seed's wall begins [m, seed's frame].

    The search starts at the seed. It follows a tilted wall along y until z of the edge decreases no
    more. The result is None if the wall has too few points.

    Args:
        own: (K, 3) points between the pads' sides [m, seed's frame: y closing, z approach].
    """
    center, edge = 0.0, np.inf
    while True:
        wall = own[np.abs(own[:, 1] - center) < 0.5 * _GAP]
        if len(wall) < MIN_POINTS:
            return None if np.isinf(edge) else (edge, center)
        found = _strip_edge(wall)
        if found > edge - _SURFACE_NOISE:
            return min(found, edge), center
        edge = found
        center = float(np.median(wall[wall[:, 2] < edge + _GAP, 1]))


def _strip_edge(wall: np.ndarray) -> float:
    """Returns z of a wall's edge: the median of three strips, because the edge may be tilted."""
    strips = np.linspace(-0.5, 0.5, 4) * _PAD_WIDTH
    firsts = [wall[(wall[:, 0] >= low) & (wall[:, 0] <= high), 2] for low, high in pairwise(strips)]
    return float(np.median([z.min() for z in firsts if z.size]))


def _runs(own: np.ndarray, center: float) -> list[np.ndarray]:
    """Returns the runs of neighbouring walls that contain the seed's wall and fit into the hand.

    Args:
        own: (K, 3) points between the fingers [m, seed's frame].
        center: y of the seed's wall [m].

    Returns:
        The indices of each run's points, by increasing y.
    """
    if not len(own):
        return []
    order = np.argsort(own[:, 1], kind="stable")
    y = own[order, 1]
    breaks = np.flatnonzero(np.diff(y) > _GAP)
    starts, ends = np.r_[0, breaks + 1], np.r_[breaks + 1, len(y)]
    mine = int(np.searchsorted(ends, np.argmin(np.abs(y - center)), side="right"))
    widest = GRIPPER.max_width - 2.0 * min(OPENING_CLEARANCES)
    return [
        order[start:end]
        for start in starts[: mine + 1]
        for end in ends[mine:]
        if end - start >= MIN_POINTS and y[end - 1] - y[start] <= widest
    ]


def _alignment(own: np.ndarray, cosines: np.ndarray) -> float:
    """Returns the mean |cos| between closing axis and normals at the worse of the two contacts.

    The result is 0 if a contact is at the pad's edge, where the object would slip or turn.

    Args:
        own: (K, 3) points between the fingers, by increasing y [m].
        cosines: (K,) cosines of the angles between the closing axis and the points' normals.
    """
    y = own[:, 1]
    worst = 1.0
    for contact in (y > y[-1] - _SURFACE_NOISE, y < y[0] + _SURFACE_NOISE):
        if abs(own[contact, 0].mean()) > _CONTACT_OFFSET:
            return 0.0
        worst = min(worst, float(np.abs(cosines[contact]).mean()))
    return worst


def _grip(y: np.ndarray, tip: float, X_WSeed: np.ndarray, alignment: float) -> Grip:
    """Returns the grip on points at ascending y (K,), the tips at z = `tip` [m, seed's frame]."""
    low, high = y[0], y[-1]
    origin = np.array([0.0, 0.5 * (low + high), tip - GRIPPER.tip_end])
    contact_z = tip - 0.5 * _INSERTION_DEPTHS[0]
    contacts = np.array([[0.0, high, contact_z], [0.0, low, contact_z]])
    return Grip(
        make_transform(X_WSeed[:3, :3], transform_points(X_WSeed, origin)),
        float(high - low),
        transform_points(X_WSeed, contacts),
        alignment,
        len(y),
    )
