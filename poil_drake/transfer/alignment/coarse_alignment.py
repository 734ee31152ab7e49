"""Coarse alignment of a demonstrated part with a target part (POIL sections III-A and B)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.geometry.rotation_grid import super_fibonacci_rotations
from poil_drake.transfer.alignment.problem import AlignmentProblem
from poil_drake.transfer.alignment.state import AlignmentState
from poil_drake.transfer.progress import Progress

MODE_ANGLE = np.deg2rad(30.0)
"""Alignments whose rotations differ by less than this are the same mode [rad]."""

_ROTATIONS = 720  # Each orientation is within 25 degrees of one, where the descent converges.
_SEARCH_ANGLE = np.deg2rad(20.0)  # Rotations closer than this are one candidate.
_CANDIDATES, _FINALISTS = 32, 8  # How many rotations are refined, with few and with more points.
_SEARCH_POINTS, _DESCENT_POINTS = 60, 100  # Of each cloud, for all rotations and for candidates.
_PART_POINTS, _CONTEXT_POINTS = 200, 300  # For finalists.
_DESCENT_STEPS, _FINAL_STEPS = 12, 30  # Of candidates and of finalists.

_SEARCH_WIDTH, _FIRST_WIDTH, _MIDDLE_WIDTH, _LAST_WIDTH = 0.35, 0.5, 0.16, 0.12
"""Truncation widths of the Chamfer distance in the search, and at the start of the descent, between
its two stages and at its end, in units of the part's root mean square radius. The width is large at
first, so that distant parts find each other, and about the sensor's noise at the end (2 to 3 mm on
a handle)."""

_CONTEXT_WIDTH = 0.1  # Width for the rest of the object in the final score.

SYMMETRY_TOLERANCE = 0.15
"""Largest Chamfer distance between a symmetric part and its turned copy, relative to the part's
root mean square radius. For a handle of 25 mm by 8 mm seen from one side, the distance is 0.15."""

_KEPT = 0.8  # Fraction of the points that count, nearest first; the rest may have no counterpart.


@dataclass(frozen=True, eq=False)
class CoarseAlignment:
    """A transform that puts the demonstrated part onto the target's: x -> A (x - c) + c'.

    A = R U diag(s) U^T: scales s along the principal axes U of the demonstrated part, then a
    rotation R.

    Attributes:
        rotation: (3, 3) R, from the demonstration's to the target's world.
        axes: (3, 3) U, whose columns are the principal axes.
        scales: (3,) s.
        source_center: (3,) c [m].
        target_center: (3,) c' [m].
        cost: The minimised cost; comparable only between alignments of the same clouds.
    """

    rotation: np.ndarray
    axes: np.ndarray
    scales: np.ndarray
    source_center: np.ndarray
    target_center: np.ndarray
    cost: float

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Returns where demonstrated points (P, 3) [m] lie on the target [m]."""
        A = self.rotation @ (self.axes * self.scales) @ self.axes.T
        return (points - self.source_center) @ A.T + self.target_center


def symmetric_alignments(
    problem: AlignmentProblem, target_part: np.ndarray, *, progress: Progress | None = None
) -> list[CoarseAlignment]:
    """Returns the best alignment and its alternatives, best first.

    If the target's part looks the same after half a turn about a principal axis, the alignment
    followed by this turn fits the part equally well, but leads to another reference (POIL section
    III-B). The search may miss such turns of the best alignment, so they are refined, too.
    Alignments that cost more than `CoarseAlignmentConfig.cost_margin` above the best one, for
    example because they do not fit the rest of the object, are left out.

    Args:
        problem: The alignment problem.
        target_part: (Q, 3) the target's part [m].
        progress: Called with the current activity and its completed fraction.
    """
    found = align_parts(problem, progress=progress)

    def is_new(rotation: np.ndarray) -> bool:
        return all(rotation_angle(rotation @ a.rotation.T) > MODE_ANGLE for a in found)

    turns, chamfers = half_turns(target_part)
    turned = [turn @ found[0].rotation for turn in turns[chamfers <= SYMMETRY_TOLERANCE]]
    turned = [rotation for rotation in turned if is_new(rotation)]
    if turned:
        for extra in align_parts(problem, np.array(turned)):
            if is_new(extra.rotation):
                found.append(extra)
    found.sort(key=lambda a: a.cost)
    return [a for a in found if a.cost <= found[0].cost + problem.config.cost_margin]


def align_parts(
    problem: AlignmentProblem,
    rotations: np.ndarray | None = None,
    *,
    progress: Progress | None = None,
) -> list[CoarseAlignment]:
    """Returns the distinct ways in which a demonstrated part fits the target's, best first.

    Rotations are scored with the parts' centroids aligned. Gauss-Newton descent then refines the
    best ones in rotation, translation and logarithmic scales. The Chamfer distance is truncated,
    because each scene shows only one side of the part. Of results with nearly the same orientation
    only the best is kept.

    Args:
        problem: The alignment problem.
        rotations: (K, 3, 3) rotations to start from; None for a grid over all orientations.
        progress: Called with the current activity and its completed fraction.
    """

    def report(fraction: float) -> None:
        if progress is not None:
            progress("aligning the parts", fraction)

    if rotations is None:
        rotations = super_fibonacci_rotations(_ROTATIONS)
    state = AlignmentState.start(rotations)
    costs = problem.thinned(_SEARCH_POINTS, _SEARCH_POINTS).cost(state, _SEARCH_WIDTH)
    state = state.select(distinct_rotations(state.R, costs, angle=_SEARCH_ANGLE, count=_CANDIDATES))
    report(0.2)
    thin = problem.thinned(_DESCENT_POINTS, _DESCENT_POINTS)
    state = thin.descend(state, np.geomspace(_FIRST_WIDTH, _MIDDLE_WIDTH, _DESCENT_STEPS))
    costs = thin.cost(state, _MIDDLE_WIDTH)
    state = state.select(distinct_rotations(state.R, costs, angle=MODE_ANGLE, count=_FINALISTS))
    report(0.5)
    thin = problem.thinned(_PART_POINTS, _CONTEXT_POINTS)
    state = thin.descend(state, np.geomspace(_MIDDLE_WIDTH, _LAST_WIDTH, _FINAL_STEPS))
    report(0.9)
    # One finalist at a time: all points of all finalists would need too much memory.
    costs = np.concatenate(
        [
            problem.cost(state.select(np.array([k])), _LAST_WIDTH, _CONTEXT_WIDTH)
            for k in range(len(state))
        ]
    )
    modes = distinct_rotations(state.R, costs, angle=MODE_ANGLE, count=problem.config.max_modes)
    report(1.0)
    frame = problem.part.frame
    return [
        CoarseAlignment(
            rotation=state.R[k],
            axes=frame.axes,
            scales=np.exp(state.log_scales[k, 0]),
            source_center=frame.source_center,
            target_center=frame.target_center + frame.length * state.translations[k, 0],
            cost=float(costs[k]),
        )
        for k in modes
    ]


def distinct_rotations(
    rotations: np.ndarray, costs: np.ndarray, *, angle: float, count: int
) -> np.ndarray:
    """Returns the indices of the cheapest rotations that differ pairwise by more than an angle.

    Args:
        rotations: (K, 3, 3) rotation matrices.
        costs: (K,) their costs.
        angle: Smallest angle between two of the returned rotations [rad].
        count: Largest number of indices.

    Returns:
        (M,) indices in order of increasing cost, 1 <= M <= count.
    """
    kept: list[int] = []
    for index in np.argsort(costs, kind="stable"):
        traces = np.einsum("kij,ij->k", rotations[kept], rotations[index])
        if np.all(traces < 1.0 + 2.0 * np.cos(angle)):
            kept.append(int(index))
        if len(kept) == count:
            break
    return np.array(kept)


def half_turns(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compares a part with its copies turned by 180 degrees about its principal axes.

    Args:
        points: (P, 3) the part [m].

    Returns:
        The rotation matrices (3, 3, 3), starting with the axis of the largest extent, and the
        trimmed mean distances (3,) between the part and its turned copies, relative to the part's
        root mean square radius.
    """
    arms = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(arms.T @ arms)
    radius = float(np.sqrt(np.mean(np.sum(arms**2, axis=1))))
    tree = cKDTree(arms)
    count = max(1, round(_KEPT * len(arms)))
    turns = np.array([2.0 * np.outer(axis, axis) - np.eye(3) for axis in axes.T[::-1]])
    # A half turn is its own inverse, so both directions have the same distances.
    distances = [np.sort(tree.query(arms @ turn.T)[0])[:count].mean() for turn in turns]
    return turns, np.array(distances) / max(radius, 1e-12)
