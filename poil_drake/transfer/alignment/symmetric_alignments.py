"""The alignments that are about equally good: more than one where a part is symmetric."""

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.transfer.alignment.coarse_alignment import (
    MODE_ANGLE,
    CoarseAlignment,
    align_parts,
)
from poil_drake.transfer.alignment.problem import AlignmentProblem
from poil_drake.transfer.progress import Progress

SYMMETRY_TOLERANCE = 0.15
"""Largest Chamfer distance between a symmetric part and its turned copy, relative to the part's
root mean square radius. For a handle of 25 mm by 8 mm seen from one side, the distance is 0.15."""

_KEPT = 0.8  # Fraction of the points that count, nearest first; the rest may have no counterpart.


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
