"""The cost of a coarse alignment, and its minimisation."""

from dataclasses import dataclass, replace

import numpy as np

from poil_drake.errors import TransferError
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.transfer.alignment.cloud_term import CONTEXT_CLOUD, PART_CLOUD, CloudTerm
from poil_drake.transfer.alignment.join_term import JoinTerm
from poil_drake.transfer.alignment.state import AlignmentState, NormalEquations

_SCALES = np.r_[3:6, 9:12]
_SCALE_DEVIATION = 0.25  # Of the logarithmic scales: mugs differ by 25 percent.
_NORMAL_WEIGHT = 0.25  # Distinguishes the inside of a wall from its outside.
_JOIN_WEIGHT = 0.3
_DAMPING = 1e-4
_MIN_POINTS = 12  # Fewer points have no shape to align.


@dataclass(frozen=True, kw_only=True)
class CoarseAlignmentConfig:
    """How parts are aligned coarsely. Costs are on the scale of a truncated Chamfer distance.

    Attributes:
        max_modes: Largest number of alignments that the search returns.
        cost_margin: Alignments that cost at most this much more than the best one are alternatives
            to it. Aligning an upright mug upside down costs 0.08 to 0.2 more, because of its body
            and of `upright_weight`; with the handle alone it would cost the same.
        scale_weight: Weight of the prior, which prefers scales near 1. It is small, so the prior
            only decides scales that the views do not show.
        context_weight: Weight of the Chamfer distance of the rest of the object, relative to that
            of the part. The paper aligns parts alone (0), but a handle seen from one side is
            ambiguous; the body shows where up and outside are.
        upright_weight: Cost of an object that is turned upside down (by 180 degrees from its
            vertical), because objects usually stand the way they did in the demonstration. The
            paper has no such cost. It is small, so it only decides between nearly equal fits.
    """

    max_modes: int = 6
    cost_margin: float = 0.06
    scale_weight: float = 0.02
    context_weight: float = 1.0
    upright_weight: float = 0.06


@dataclass(frozen=True, eq=False)
class AlignmentProblem:
    """Aligns a demonstrated part, and the rest of its object, with those of the target.

    The cost is a weighted sum of E_part, E_rest, E_join and priors on scales and the vertical.
    E_part and E_rest are the truncated Chamfer energies of `CloudTerm`, and E_join is the energy of
    `JoinTerm`. The paper's cost is E_part alone, over rotation, translation and scales along the
    principal axes.

    Attributes:
        part: The part's term.
        context: The term of the rest of the object; None if the rest is unknown or has no weight.
        join: The term that keeps part and rest together; None if there is no context, or the part
            is nowhere close to it.
        config: Weights of the terms.
    """

    part: CloudTerm
    context: CloudTerm | None
    join: JoinTerm | None
    config: CoarseAlignmentConfig

    @classmethod
    def between(
        cls,
        source_part: PointCloud,
        target_part: PointCloud,
        *,
        source_context: PointCloud | None = None,
        target_context: PointCloud | None = None,
        config: CoarseAlignmentConfig,
    ) -> "AlignmentProblem":
        """Returns the problem of aligning two parts, with the rest of their objects if it is known.

        Args:
            source_part: The demonstrated part.
            target_part: The target's part.
            source_context: The rest of the demonstrated object, with normals. It is ignored without
                `target_context`.
            target_context: The rest of the target object, with normals. It is ignored without
                `source_context`.
            config: Weights of the terms.

        Raises:
            TransferError: if a part has too few points to align.
        """
        for name, cloud in (("demonstrated", source_part), ("target", target_part)):
            if len(cloud) < _MIN_POINTS:
                raise TransferError(
                    f"The cloud of the {name} part has only {len(cloud)} points; "
                    f"{_MIN_POINTS} are needed to align it.",
                    remedy="Turn the object so that a camera sees more of the part, move a camera "
                    "nearer, or use images of more pixels.",
                )
        part = CloudTerm.between(source_part, target_part, cloud=PART_CLOUD)
        if source_context is None or target_context is None or config.context_weight == 0.0:
            return cls(part, None, None, config)
        context = CloudTerm.between(
            source_context, target_context, cloud=CONTEXT_CLOUD, normal_weight=_NORMAL_WEIGHT
        )
        join = JoinTerm.between(part, context, part=source_part, context=source_context)
        return cls(part, context, join, config)

    def thinned(self, part_points: int, context_points: int) -> "AlignmentProblem":
        """Returns a cheaper problem, with at most these numbers of points in each cloud."""
        context = self.context and self.context.thinned(context_points)
        return replace(self, part=self.part.thinned(part_points), context=context)

    def cost(
        self, state: AlignmentState, width: float, context_width: float | None = None
    ) -> np.ndarray:
        """Returns the costs (K,) of candidates.

        Args:
            state: K candidates.
            width: Truncation width of the part's energy, in units of its `CloudFrame.length`.
            context_width: The same for the context's energy and `CloudFrame`; None for `width`.
        """
        config = self.config
        squares = np.sum(state.log_scales**2, axis=(1, 2))
        cost = self.part.energy(state, width) + config.scale_weight / _SCALE_DEVIATION**2 * squares
        # The element of R is the cosine of the angle by which the vertical has turned.
        cost += config.upright_weight * 0.5 * (1.0 - state.R[:, 2, 2])
        if self.context is not None:
            cost += config.context_weight * self.context.energy(state, context_width or width)
        if self.join is not None:
            cost += _JOIN_WEIGHT * self.join.energy(state)
        return cost

    def descend(self, state: AlignmentState, widths: np.ndarray) -> AlignmentState:
        """Returns the candidates after one Gauss-Newton step for each truncation width (S,)."""
        config = self.config
        for width in widths:
            equations = NormalEquations.zero(len(state))
            self.part.linearize(state, width, 1.0, equations)
            if self.context is not None:
                self.context.linearize(state, width, config.context_weight, equations)
            if self.join is not None:
                self.join.linearize(state, _JOIN_WEIGHT, equations)
            curvature = 2.0 * config.scale_weight / _SCALE_DEVIATION**2
            equations.H[:, _SCALES, _SCALES] += curvature
            equations.g[:, _SCALES] += curvature * state.log_scales.reshape(len(state), 6)
            state = state.moved(equations.solve(_DAMPING))
        return state
