"""Model points against the depth that is measured where they project to."""

from dataclasses import dataclass

import numpy as np

from poil_drake.perception.trackers.rigid_flow.alignment.config import DepthConfig
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    cross_rows,
    tukey_weights,
)
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow


@dataclass(frozen=True, eq=False)
class OrientedPoints:
    """Points of a surface with what the point-to-plane residual needs of them, in one frame.

    Attributes:
        points: (M, 3) [m].
        normals: (M, 3) unit.
        offsets: (M,) n . q [m].
        rows: (M, 6) (q x n, n), the Jacobian of n . q by a motion (ω, v).
        trust: (M,) weights in (0, 1].
        features: (3, M) of their colours, as of `color_features`.
    """

    points: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    rows: np.ndarray
    trust: np.ndarray
    features: np.ndarray

    def select(self, index: np.ndarray) -> "OrientedPoints":
        """Returns some of the points, by index."""
        return OrientedPoints(
            self.points[index],
            self.normals[index],
            self.offsets[index],
            self.rows[index],
            self.trust[index],
            self.features[:, index],
        )


@dataclass(frozen=True, eq=False)
class DepthSamples:
    """Depth measured at the model points that face a camera and have depth, K of them.

    Attributes:
        index: (K,) which model points.
        pixels: (2, K) u and v of theirs in the window.
        residuals: (K,) how far outward along its normal each one's surface is measured [m].
        behind: (K,) how much farther than predicted the depth is measured [m].
    """

    index: np.ndarray
    pixels: tuple[np.ndarray, np.ndarray]
    residuals: np.ndarray
    behind: np.ndarray


def sample_depth(
    surface: OrientedPoints, window: ViewWindow, X_WO: np.ndarray, min_cosine: float
) -> DepthSamples:
    """Looks up the depth at each model point's pixel.

    The measured point lies on that pixel's own line of sight, so that rounding to the pixel costs
    nothing on a plane.

    Args:
        surface: Model points in the object's frame.
        window: The view.
        X_WO: (4, 4) pose of the object.
        min_cosine: Least cosine between a normal and the line of sight.
    """
    sight = window.sight(X_WO)
    points_C = sight.to_camera(surface.points)
    z = points_C[:, 2]
    facing = surface.normals @ sight.eye - surface.offsets
    candidates = np.flatnonzero((facing > min_cosine * z) & (z > 0.05))
    u, v = window.project(points_C[candidates])
    u, v = np.rint(u).astype(np.intp), np.rint(v).astype(np.intp)
    height, width = window.surface.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    candidates, u, v = candidates[inside], u[inside], v[inside]
    depth = window.surface[v, u].astype(float)
    valid = depth > 0.0
    index, u, v, depth = candidates[valid], u[valid], v[valid], depth[valid]
    measured = sight.to_object(window.unproject(u, v, depth))
    residuals = np.einsum("mi,mi->m", surface.normals[index], measured) - surface.offsets[index]
    return DepthSamples(index, (u, v), residuals, depth - z[index])


def add_depth_term(
    equations: NormalEquations,
    surface: OrientedPoints,
    window: ViewWindow,
    X_WO: np.ndarray,
    gate: float,
    config: DepthConfig,
    *,
    final: bool,
) -> None:
    """Adds the point-to-plane residuals of one view; if final, also what is spurious in them."""
    samples = sample_depth(surface, window, X_WO, config.min_cosine)
    weights = tukey_weights(samples.residuals, gate)
    # At a slant a small distance along the normal may be a large one along the line of sight.
    weights[np.abs(samples.behind) > 3.0 * gate] = 0.0
    weights *= surface.trust[samples.index] / (config.deviation**2 * config.correlation)
    equations.add(surface.rows[samples.index], samples.residuals, weights)
    if not final:
        return
    points = surface.points[samples.index]
    errors = weights * config.normal_deviation**2
    for axis in np.eye(3):
        # A normal that errs along this axis.
        equations.add_spurious(
            np.hstack([cross_rows(points, axis), np.broadcast_to(axis, points.shape)]), errors
        )
