"""Parameters of the coarse alignment."""

from dataclasses import dataclass


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
