"""Coarse alignment of a demonstrated part with a target part (POIL section III-A)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.transfer.alignment.config import CoarseAlignmentConfig
from poil_drake.transfer.alignment.problem import AlignmentProblem
from poil_drake.transfer.alignment.rotation_grid import (
    distinct_rotations,
    super_fibonacci_rotations,
)
from poil_drake.transfer.alignment.state import AlignmentState

Progress = Callable[[str, float], None]
"""Called with what is being done and the fraction of it that is done."""


@dataclass(frozen=True, eq=False)
class CoarseAlignment(SharedOnCopy):
    """A transform that puts the demonstrated part onto the target's: x -> A (x - c) + c'.

    A = R U diag(s) U^T: scales s along the principal axes U of the demonstrated part, then a
    rotation R.

    Attributes:
        rotation: (3, 3) R, from the demonstration's to the target's world.
        axes: (3, 3) U, columns are the principal axes.
        scales: (3,) s.
        source_center: (3,) c [m].
        target_center: (3,) c' [m].
        cost: What was minimised, the lower the better; comparable between alignments of the same
            clouds only.
    """

    rotation: np.ndarray
    axes: np.ndarray
    scales: np.ndarray
    source_center: np.ndarray
    target_center: np.ndarray
    cost: float

    def __post_init__(self) -> None:
        for name, shape in (
            ("rotation", (3, 3)),
            ("axes", (3, 3)),
            ("scales", (3,)),
            ("source_center", (3,)),
            ("target_center", (3,)),
        ):
            value = frozen_array(getattr(self, name), name=f"CoarseAlignment.{name}", shape=shape)
            object.__setattr__(self, name, value)

    @property
    def matrix(self) -> np.ndarray:
        """The (3, 3) linear map A."""
        return self.rotation @ (self.axes * self.scales) @ self.axes.T

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Returns demonstrated points (P, 3) [m] as they lie on the target [m]."""
        return (points - self.source_center) @ self.matrix.T + self.target_center


def align_parts(
    source_part: PointCloud,
    target_part: PointCloud,
    *,
    source_context: PointCloud | None = None,
    target_context: PointCloud | None = None,
    config: CoarseAlignmentConfig | None = None,
    progress: Progress | None = None,
) -> tuple[CoarseAlignment, ...]:
    """Returns the ways in which a demonstrated part fits the target's, best first.

    Rotations spread over all orientations are scored with the parts' centroids on each other; the
    best descend in rotation, translation and logarithmic scales together, with a truncated Chamfer
    distance, since each scene shows only a side of its part. What is left of those that end in the
    same orientation is the best; different orientations stay, so that symmetric parts give several.

    Args:
        source_part: The demonstrated part.
        target_part: The target's part.
        source_context: The rest of the demonstrated object, with normals. With both contexts
            they count too, with a transform that shares the rotation only.
        target_context: The rest of the target object, with normals.
        config: Parameters, None for the defaults.
        progress: Told how far the search is.

    Raises:
        TransferError: if a part has too few points to align.
    """
    problem = AlignmentProblem.between(
        source_part,
        target_part,
        source_context=source_context,
        target_context=target_context,
        config=config or CoarseAlignmentConfig(),
    )
    rotations = super_fibonacci_rotations(problem.config.rotations)
    return refine_rotations(problem, rotations, progress=progress)


def refine_rotations(
    problem: AlignmentProblem, rotations: np.ndarray, *, progress: Progress | None = None
) -> tuple[CoarseAlignment, ...]:
    """Returns the distinct alignments that given rotations (K, 3, 3) descend to, best first."""
    config = problem.config
    search_width, first_width, middle_width, last_width = config.widths

    def tell(fraction: float) -> None:
        if progress is not None:
            progress("aligning the parts", fraction)

    state = AlignmentState.start(rotations)
    costs = problem.thinned(config.search_points, config.search_points).cost(state, search_width)
    state = state.select(
        distinct_rotations(state.R, costs, angle=config.search_angle, count=config.candidates)
    )
    tell(0.2)
    thin = problem.thinned(config.descent_points, config.descent_points)
    state = thin.descend(state, np.geomspace(first_width, middle_width, config.descent_steps))
    costs = thin.cost(state, middle_width)
    state = state.select(
        distinct_rotations(state.R, costs, angle=config.mode_angle, count=config.finalists)
    )
    tell(0.5)
    thin = problem.thinned(config.part_points, config.context_points)
    state = thin.descend(state, np.geomspace(middle_width, last_width, config.final_steps))
    tell(0.9)
    # One at a time: all points of all finalists at once would take much memory.
    costs = np.concatenate(
        [
            problem.cost(state.select(np.array([k])), last_width, config.context_width)
            for k in range(len(state))
        ]
    )
    modes = distinct_rotations(state.R, costs, angle=config.mode_angle, count=config.max_modes)
    tell(1.0)
    return tuple(_alignment(problem, state, int(k), float(costs[k])) for k in modes)


def _alignment(
    problem: AlignmentProblem, state: AlignmentState, k: int, cost: float
) -> CoarseAlignment:
    frame = problem.part.frame
    return CoarseAlignment(
        rotation=state.R[k],
        axes=frame.axes,
        scales=np.exp(state.log_scales[k, 0]),
        source_center=frame.source_center,
        target_center=frame.target_center + frame.length * state.translations[k, 0],
        cost=cost,
    )
