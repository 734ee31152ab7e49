"""The depth term: model points against the depth measured at their projections (ICP)."""

from dataclasses import dataclass

import numpy as np

from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    motion_jacobian,
    tukey_weights,
)
from poil_drake.perception.trackers.rigid_flow.rows import Rows
from poil_drake.perception.trackers.rigid_flow.view_window import PosedView

_MIN_COSINE = 0.25  # between a surface normal and the line of sight
_DEVIATION = 0.001  # of a residual [m]: depth noise and the model's error
_CORRELATION = 20.0  # residuals that count as one, since errors of neighbours are correlated
_NORMAL_DEVIATION = 0.06  # of the model's normals [rad]


@dataclass(frozen=True, eq=False)
class OrientedPoints(Rows):
    """Points on a surface, with precomputed parts of their point-to-plane residuals.

    Attributes:
        points: (M, 3) points q [m].
        normals: (M, 3) unit normals n.
        offsets: (M,) n . q [m].
        jacobian: (M, 6) (q x n, n), the derivative of n . q with respect to a motion (ω, v).
        trust: (M,) weights in (0, 1].
        features: (M, 3) `color_features` of the points' colours.
    """

    points: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    jacobian: np.ndarray
    trust: np.ndarray
    features: np.ndarray

    @classmethod
    def make(
        cls, points: np.ndarray, normals: np.ndarray, features: np.ndarray, trust: float
    ) -> "OrientedPoints":
        """Returns oriented points that all have the weight `trust`."""
        offsets = np.einsum("mi,mi->m", points, normals)
        jacobian, weights = motion_jacobian(points, normals), np.full(len(points), trust)
        return cls(points, normals, offsets, jacobian, weights, features)


@dataclass(frozen=True, eq=False)
class DepthSamples:
    """Depth measured at the K model points that face the camera and have valid depth.

    Attributes:
        index: (K,) indices of the model points.
        pixels: Coordinates u (K,) and v (K,) of the points' pixels in the window.
        residuals: (K,) distance from the model point to the measured surface along the model's
            normal, positive outward [m].
        behind: (K,) measured minus predicted depth [m].
    """

    index: np.ndarray
    pixels: tuple[np.ndarray, np.ndarray]
    residuals: np.ndarray
    behind: np.ndarray


def sample_depth(
    surface: OrientedPoints, view: PosedView, min_cosine: float = _MIN_COSINE
) -> DepthSamples:
    """Looks up the depth at each model point's pixel.

    The measured point is on that pixel's line of sight, so rounding to pixels causes no error on
    planes.

    Args:
        surface: Model points in the object's frame.
        view: The view.
        min_cosine: Least cosine between a normal and the line of sight.
    """
    window = view.window
    points_C = view.to_camera(surface.points)
    z = points_C[:, 2]
    facing = surface.normals @ view.eye - surface.offsets
    candidates = np.flatnonzero((facing > min_cosine * z) & (z > 0.05))
    u, v = window.project(points_C[candidates])
    u, v = np.rint(u).astype(np.intp), np.rint(v).astype(np.intp)
    height, width = window.surface.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    candidates, u, v = candidates[inside], u[inside], v[inside]
    depth = window.surface[v, u].astype(float)
    valid = depth > 0.0
    index, u, v, depth = candidates[valid], u[valid], v[valid], depth[valid]
    measured = view.unproject(u, v, depth)
    residuals = np.einsum("mi,mi->m", surface.normals[index], measured) - surface.offsets[index]
    return DepthSamples(index, (u, v), residuals, depth - z[index])


def add_depth_term(
    equations: NormalEquations,
    surface: OrientedPoints,
    view: PosedView,
    gate: float,
    *,
    final: bool,
) -> None:
    """Adds the point-to-plane residuals of one view.

    Args:
        equations: The equations to add to.
        surface: Model points in the object's frame.
        view: The view.
        gate: Residuals above this do not count [m].
        final: Whether to also add errors of the normals to `equations.spurious`.
    """
    samples = sample_depth(surface, view)
    weights = tukey_weights(samples.residuals, gate)
    # On a slanted surface, a short distance along the normal may be a long one in depth.
    weights[np.abs(samples.behind) > 3.0 * gate] = 0.0
    weights *= surface.trust[samples.index] / (_DEVIATION**2 * _CORRELATION)
    equations.add(surface.jacobian[samples.index], samples.residuals, weights)
    if not final:
        return
    points = surface.points[samples.index]
    errors = weights * _NORMAL_DEVIATION**2
    for axis in np.eye(3):  # Errors of the normals along this axis.
        equations.add_spurious(motion_jacobian(points, axis), errors)
