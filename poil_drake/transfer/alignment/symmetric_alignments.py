"""The alignments that are about equally good: more than one where a part is symmetric."""

import numpy as np

from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.transfer.alignment.coarse_alignment import (
    MODE_ANGLE,
    CoarseAlignment,
    align_parts,
)
from poil_drake.transfer.alignment.problem import AlignmentProblem
from poil_drake.transfer.progress import Progress
from poil_drake.transfer.symmetry import SYMMETRY_TOLERANCE, half_turns


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
