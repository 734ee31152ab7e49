"""The free-space term: observed points against the space where the object is known not to be.

If a view shows a mug's handle beside the model's handle, the points observed on the mug's handle
lie in free space. This term then turns the model's handle towards these points.
"""

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    motion_jacobian,
    tukey_weights,
)
from poil_drake.perception.trackers.rigid_flow.free_space import (
    TOLERANCE,
    FreeSpaceGrid,
    ObservedPoints,
)

GATE = 0.03
"""Points deeper than this in free space belong to something else [m]."""

_DEVIATION = 0.003  # of how deep in free space a point of the object is [m]
_CORRELATION = 4.0  # observed points that count as one, since their errors are correlated


def add_free_space_term(
    equations: NormalEquations,
    free_space: FreeSpaceGrid,
    observed: ObservedPoints,
    X_WO: np.ndarray,
    radius: float,
) -> None:
    """Adds how deep the observed points lie in free space, as residuals.

    Args:
        equations: The equations to add to.
        free_space: Where the object is known not to be.
        observed: Points that have the object's colours.
        X_WO: (4, 4) pose of the object.
        radius: Radius of the object [m]. Points farther from the object's origin do not count.
    """
    points = transform_points(inverse(X_WO), observed.points)
    depth = free_space.depth_at(tuple(points.T)) - TOLERANCE
    inside = (depth > 0.0) & (np.einsum("qi,qi->q", points, points) < radius**2)
    if not np.any(inside):
        return
    points, depth = points[inside], depth[inside]
    slopes = [
        free_space.depth_at(tuple((points + h).T)) - free_space.depth_at(tuple((points - h).T))
        for h in free_space.spacing * np.eye(3)
    ]
    outward = np.stack(slopes, axis=1) / (2.0 * free_space.spacing)
    # A motion d = (ω, v) of the object moves a point q of the world by -(v + ω x q) within it.
    jacobian = -motion_jacobian(points, outward)
    weights = observed.weights[inside] * tukey_weights(depth, GATE)
    equations.add(jacobian, -depth, weights / (_DEVIATION**2 * _CORRELATION))
