"""Parameters of the coarse alignment."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class CoarseAlignmentConfig:
    """How parts are aligned coarsely. Lengths are in units of the part's root mean square radius.

    Attributes:
        rotations: How many rotations are tried, spread over all orientations. 720 leave at most
            about 25 degrees to the nearest, from where the descent finds the way.
        candidates: How many of them descend with thinned clouds.
        finalists: How many descend further with more points.
        search_points: Points of each cloud in the search.
        descent_points: Points of each cloud when candidates descend.
        part_points: Points of the part when finalists descend.
        context_points: Points of the rest of the object when finalists descend.
        score_points: Points of each cloud in the final score.
        descent_steps: Gauss-Newton steps of the candidates.
        final_steps: Gauss-Newton steps of the finalists.
        widths: Width of the Chamfer distance's truncation in the search, at the descent's begin,
            after the candidates' descent, and at its end. It narrows step by step: wide at first to
            find the way from far, in the end about the sensor's noise (2 to 3 mm on a handle).
        search_angle: Rotations nearer than this are one candidate [rad].
        mode_angle: Results nearer than this are one mode [rad].
        max_modes: At most this many results.
        scale_bounds: Smallest and largest scale along a principal axis.
        scale_deviation: Standard deviation of the logarithmic scales: mugs differ by 25 percent.
        scale_weight: Weight of that prior. Small: it only decides what the views do not show.
        tangential_weight: What offsets along the surface count in the descent, of 1. Small, so that
            clouds slide along themselves into place.
        context_weight: Weight of the rest of the object's Chamfer distance relative to the part's.
            This goes beyond the paper, which aligns parts alone (0): a handle seen from one side is
            ambiguous, while the body shows where up and outside are.
        context_width: Truncation in the final score of the rest of the object.
        normal_weight: How far apart opposite normals of the rest of the object are, over two. Tells
            the inside of a wall from its outside.
        join_weight: Weight of part and rest staying joined.
        join_reach: Part and rest join where they are this near.
        join_across: Allowed offset across the rest's surface, a standard deviation.
        join_along: Allowed offset along it.
        upright_weight: Cost of an object turned upside down (rotation of its vertical by 180
            degrees). Beyond the paper, too: things usually stand the way they did when the skill
            was shown. Small, so that it decides only between about equal fits.
        max_turn: Longest turn about an axis in one step [rad].
    """

    rotations: int = 720
    candidates: int = 32
    finalists: int = 8
    search_points: int = 60
    descent_points: int = 100
    part_points: int = 200
    context_points: int = 300
    score_points: int = 1500
    descent_steps: int = 12
    final_steps: int = 30
    widths: tuple[float, float, float, float] = (0.35, 0.5, 0.16, 0.12)
    search_angle: float = np.deg2rad(20.0)
    mode_angle: float = np.deg2rad(30.0)
    max_modes: int = 6
    scale_bounds: tuple[float, float] = (0.6, 1.7)
    scale_deviation: float = 0.25
    scale_weight: float = 0.02
    tangential_weight: float = 0.3
    context_weight: float = 1.0
    context_width: float = 0.1
    normal_weight: float = 0.25
    join_weight: float = 0.3
    join_reach: float = 0.4
    join_across: float = 0.1
    join_along: float = 0.4
    upright_weight: float = 0.06
    max_turn: float = 0.4

    def __post_init__(self) -> None:
        low, high = self.scale_bounds
        if not 0.0 < low <= 1.0 <= high:
            raise InvalidValueError(
                f"CoarseAlignmentConfig.scale_bounds is {self.scale_bounds}.",
                remedy="Pass a smallest scale in (0, 1] and a largest of at least 1.",
            )
        if min(self.widths) <= 0.0 or self.context_width <= 0.0:
            raise InvalidValueError(
                f"CoarseAlignmentConfig has widths={self.widths} and "
                f"context_width={self.context_width}.",
                remedy="Widths must be positive.",
            )
