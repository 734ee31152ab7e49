"""The alignments that are about equally good: more than one where a part is symmetric."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.transfer.alignment.coarse_alignment import (
    CoarseAlignment,
    Progress,
    refine_rotations,
)
from poil_drake.transfer.alignment.config import CoarseAlignmentConfig
from poil_drake.transfer.alignment.problem import AlignmentProblem
from poil_drake.transfer.alignment.rotation_grid import super_fibonacci_rotations
from poil_drake.transfer.symmetry import SymmetryConfig, half_turns


@dataclass(frozen=True, kw_only=True)
class AmbiguityConfig:
    """Which alignments are alternatives.

    Attributes:
        cost_margin: Alignments that cost at most this much more than the best are alternatives. An
            upright mug's alignment upside down costs 0.08 to 0.2 more, by its body and by
            `CoarseAlignmentConfig.upright_weight`; by the handle alone it costs the same.
        symmetry: Which half turns of the target's part are tried besides.
    """

    cost_margin: float = 0.06
    symmetry: SymmetryConfig = field(default_factory=SymmetryConfig)


def symmetric_alignments(
    source_part: PointCloud,
    target_part: PointCloud,
    *,
    source_context: PointCloud | None = None,
    target_context: PointCloud | None = None,
    alignment: CoarseAlignmentConfig | None = None,
    ambiguity: AmbiguityConfig | None = None,
    progress: Progress | None = None,
) -> tuple[CoarseAlignment, ...]:
    """Returns the best alignment and its alternatives, best first.

    Where the target's part looks the same after a half turn about a principal axis, the alignment
    turned by it fits the part as well, but makes another reference (POIL section III-B). Those half
    turns of the best alignment that the search did not find by itself are refined, too. What the
    context speaks clearly against is left out.

    Args:
        source_part: The demonstrated part.
        target_part: The target's part.
        source_context: The rest of the demonstrated object.
        target_context: The rest of the target object.
        alignment: Parameters of the alignment, None for the defaults.
        ambiguity: What counts as an alternative, None for the defaults.
        progress: Told how far the search is.

    Raises:
        TransferError: if a part has too few points to align.
    """
    ambiguity = ambiguity or AmbiguityConfig()
    problem = AlignmentProblem.between(
        source_part,
        target_part,
        source_context=source_context,
        target_context=target_context,
        config=alignment or CoarseAlignmentConfig(),
    )
    rotations = super_fibonacci_rotations(problem.config.rotations)
    found = list(refine_rotations(problem, rotations, progress=progress))
    turned = np.array(
        [
            turn.rotation @ found[0].rotation
            for turn in half_turns(target_part.points, ambiguity.symmetry)
            if turn.symmetric
        ]
    ).reshape(-1, 3, 3)
    turned = turned[[_is_new(R, found, problem.config.mode_angle) for R in turned]]
    if len(turned):
        for extra in refine_rotations(problem, turned):
            if _is_new(extra.rotation, found, problem.config.mode_angle):
                found.append(extra)
    found.sort(key=lambda a: a.cost)
    return tuple(a for a in found if a.cost <= found[0].cost + ambiguity.cost_margin)


def _is_new(rotation: np.ndarray, found: list[CoarseAlignment], angle: float) -> bool:
    return all(rotation_angle(rotation @ a.rotation.T) > angle for a in found)
