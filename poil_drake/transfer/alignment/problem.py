"""The cost of a coarse alignment, and its descent."""

from dataclasses import dataclass, replace

import numpy as np

from poil_drake.errors import TransferError
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.transfer.alignment.cloud_term import CONTEXT_CLOUD, PART_CLOUD, CloudTerm
from poil_drake.transfer.alignment.config import CoarseAlignmentConfig
from poil_drake.transfer.alignment.state import AlignmentState, NormalEquations
from poil_drake.transfer.registration.join_term import JoinTerm

_SCALES = np.r_[3:6, 9:12]
_DAMPING = 1e-4

_MIN_POINTS = 12
"""Fewer points have no shape to align."""


@dataclass(frozen=True, eq=False)
class AlignmentProblem:
    """Aligns a demonstrated part, and the object it belongs to, with a target's.

    The cost is E_part + context_weight E_rest + join_weight E_join + priors, with the truncated
    Chamfer energies of `CloudTerm`. Without the rest of the object it is the paper's: the part's
    Chamfer distance over rotation, translation and scales along the principal axes.

    Attributes:
        part: The part's term.
        context: The rest of the object's; None where it is not known or does not count.
        join: What keeps them together; None without a context or a visible joint.
        config: Weights.
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
        source_context: PointCloud | None,
        target_context: PointCloud | None,
        config: CoarseAlignmentConfig,
    ) -> "AlignmentProblem":
        """Returns the problem of two parts, with the rest of their objects where it is known.

        Raises:
            TransferError: if a part has too few points to align.
        """
        for name, cloud in (("demonstration", source_part), ("target", target_part)):
            if len(cloud) < _MIN_POINTS:
                raise TransferError(
                    f"The part is seen with only {len(cloud)} points in the {name}; "
                    f"{_MIN_POINTS} are needed to align it.",
                    remedy="Turn the object so that a camera sees more of the part, or bring a "
                    "camera nearer.",
                )
        part = CloudTerm.between(
            source_part,
            target_part,
            cloud=PART_CLOUD,
            max_points=config.score_points,
            normal_weight=0.0,
            tangential_weight=config.tangential_weight,
        )
        if source_context is None or target_context is None or config.context_weight == 0.0:
            return cls(part, None, None, config)
        context = CloudTerm.between(
            source_context,
            target_context,
            cloud=CONTEXT_CLOUD,
            max_points=config.score_points,
            normal_weight=config.normal_weight,
            tangential_weight=config.tangential_weight,
        )
        join = JoinTerm.between(
            part,
            context,
            part=source_part,
            context=source_context,
            reach=config.join_reach,
            across=config.join_across,
            along=config.join_along,
        )
        return cls(part, context, join, config)

    def thinned(self, part_points: int, context_points: int) -> "AlignmentProblem":
        """Returns the problem with fewer points, which takes less time."""
        context = self.context and self.context.thinned(context_points)
        return replace(self, part=self.part.thinned(part_points), context=context)

    def cost(
        self, state: AlignmentState, width: float, context_width: float | None = None
    ) -> np.ndarray:
        """Returns the costs (K,); widths are those of the truncation, in units of length."""
        config = self.config
        cost = self.part.energy(state, width) + self._prior(state)
        # Things lie on tables: how far the vertical has turned.
        cost += config.upright_weight * 0.5 * (1.0 - state.R[:, 2, 2])
        if self.context is not None:
            cost += config.context_weight * self.context.energy(state, context_width or width)
        if self.join is not None:
            cost += config.join_weight * self.join.energy(state)
        return cost

    def descend(self, state: AlignmentState, widths: np.ndarray) -> AlignmentState:
        """Returns the candidates after one Gauss-Newton step for each truncation width."""
        config = self.config
        bounds = float(np.log(config.scale_bounds[0])), float(np.log(config.scale_bounds[1]))
        for width in widths:
            equations = NormalEquations.zero(len(state))
            self.part.linearize(state, width, 1.0, equations)
            if self.context is not None:
                self.context.linearize(state, width, config.context_weight, equations)
            if self.join is not None:
                self.join.linearize(state, config.join_weight, equations)
            curvature = 2.0 * config.scale_weight / config.scale_deviation**2
            equations.H[:, _SCALES, _SCALES] += curvature
            equations.g[:, _SCALES] += curvature * state.log_scales.reshape(len(state), 6)
            state = state.moved(
                equations.solve(_DAMPING), max_turn=config.max_turn, log_scale_bounds=bounds
            )
        return state

    def _prior(self, state: AlignmentState) -> np.ndarray:
        squares = np.sum(state.log_scales**2, axis=(1, 2))
        return self.config.scale_weight / self.config.scale_deviation**2 * squares
