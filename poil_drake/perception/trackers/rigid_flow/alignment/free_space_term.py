"""What is the object's by its colour, against the space where the object is known not to be.

A handle that is seen beside the model's handle lies where, carried back to the first frame, a
camera looked through. It pulls the model round, however little of the model's own handle is seen.
"""

import numpy as np

from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.trackers.rigid_flow.alignment.config import AppearanceConfig
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    cross_rows,
    tukey_weights,
)
from poil_drake.perception.trackers.rigid_flow.appearance_model import (
    AppearanceModel,
    ObservedPoints,
)


def add_free_space_term(
    equations: NormalEquations,
    appearance: AppearanceModel,
    around: ObservedPoints,
    X_WO: np.ndarray,
    radius: float,
    config: AppearanceConfig,
) -> None:
    """Adds how far observed points are inside of empty space.

    Args:
        equations: What to add to.
        appearance: How the object looks, and where it is not.
        around: Points that are the object's by their colour.
        X_WO: (4, 4) pose of the object.
        radius: Of the object [m]; points farther away do not count.
        config: Parameters.
    """
    points = transform_points(inverse(X_WO), around.points)
    depth = appearance.free_space_depth_at(tuple(points.T)) - config.tolerance
    inside = (depth > 0.0) & (np.einsum("qi,qi->q", points, points) < radius**2)
    if not np.any(inside):
        return
    points, depth = points[inside], depth[inside]
    step = appearance.spacing * np.eye(3)
    slopes = [
        appearance.free_space_depth_at(tuple((points + h).T))
        - appearance.free_space_depth_at(tuple((points - h).T))
        for h in step
    ]
    outward = np.stack(slopes, axis=1) / (2.0 * appearance.spacing)
    # As the object moves by d = (omega, v), a point q of the world moves in it by -(v + omega x q).
    rows = -np.hstack([cross_rows(points, outward), outward])
    weights = around.weights[inside] * tukey_weights(depth, config.gate)
    equations.add(rows, -depth, weights / (config.deviation**2 * config.correlation))
