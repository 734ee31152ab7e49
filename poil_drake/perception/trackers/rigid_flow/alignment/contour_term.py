"""The contour term: the model's outline against the edges of measured depth.

Depth alone poorly determines a motion along the surface, such as that of a plain cylinder along its
axis. The outline determines such a motion. Near the predicted outline, depth edges are searched for
along the outline's normal. (RAPID, Harris and Stennett 1990, does so with grey-level edges.) Depth
edges need neither texture nor contrast with the background.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import OrientedPoints
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    motion_jacobian,
    tukey_weights,
)
from poil_drake.perception.trackers.rigid_flow.rows import evenly_spaced
from poil_drake.perception.trackers.rigid_flow.view_window import PosedView, square_kernel

SEARCH_REACH = 8
"""The search for edges reaches this far to either side of the model's outline [px]."""

_SPLAT = 2  # half width of the square that a model point covers [px]; closes gaps between points
_FAR = 0.05  # how far behind the object the empty part of a rendering lies [m]
_MODEL_JUMP = 0.015  # depth step that makes an outline of the model [m]
_IMAGE_JUMP = 0.012  # depth step that ends the object in the image [m]
_INSIDE, _OUTSIDE = 3, 6  # pixels examined on the two sides of an edge
_MAX_EDGES = 160  # outline pixels of a view that are used
_DEVIATION = 1.0  # of an edge's position [px]
_CORRELATION = 6.0  # edge pixels that count as one, since errors of neighbours are correlated
_DIRECTION_DEVIATION = 0.2  # of the outline's direction [rad]


@dataclass(frozen=True, eq=False)
class ContourMatches:
    """K points on the model's outline, each with the edge that was found for it in a view.

    Attributes:
        points: (K, 3) outline points in the object's frame [m].
        directions: (K, 2) unit normals of the outline in the image, away from the object.
        targets: (K,) coordinate that each point should have along its direction [px].
        displacements: (K,) distance of each edge from the rendered outline, positive outward [px].
        searched: Number of outline pixels that were searched and not occluded.
        rendering: (h, w) float32 rendered depth of the model [m].
    """

    points: np.ndarray
    directions: np.ndarray
    targets: np.ndarray
    displacements: np.ndarray
    searched: int
    rendering: np.ndarray


def match_contour(surface: OrientedPoints, bias: float, view: PosedView) -> ContourMatches | None:
    """Finds the edges that belong to the model's outline.

    Args:
        surface: The model's surface.
        bias: Distance from the model's rendered outline outward to the object's edge [px].
        view: The view.

    Returns:
        The matches, or None if the view shows too little of the outline.
    """
    rendering = render_depth(surface, view)
    if rendering is None:
        return None
    u, v = _outline(rendering)
    if len(u) < 8:
        return None
    du, dv = _outward(rendering, u, v)
    z = rendering[v, u]
    found, occluded, shift = _search_edges(view.window.depth, u, v, du, dv, z)
    searched = int(np.count_nonzero(~occluded))
    u, v, du, dv, z, shift = (x[found] for x in (u, v, du, dv, z, shift))
    # The rendering reaches _SPLAT beyond the points; the surface ends about at the points.
    start_u, start_v = u - du * _SPLAT, v - dv * _SPLAT
    points = view.unproject(start_u, start_v, z.astype(float))
    targets = start_u * du + start_v * dv + shift - bias
    return ContourMatches(points, np.stack([du, dv], axis=1), targets, shift, searched, rendering)


def add_contour_term(
    equations: NormalEquations,
    matches: ContourMatches,
    view: PosedView,
    gate: float,
    *,
    final: bool,
) -> None:
    """Adds the distances between the model's outline and the edges found for it, as residuals.

    Args:
        equations: The equations to add to.
        matches: Matches in this view, which may have been found at another pose.
        view: The view.
        gate: Residuals above this do not count [px].
        final: Whether to also add errors of the directions to `equations.spurious`.
    """
    u, v = view.project(matches.points)
    du, dv = matches.directions[:, 0], matches.directions[:, 1]
    residuals = matches.targets - (du * u + dv * v)
    jacobian = motion_jacobian(matches.points, view.pixel_gradient(du, dv, matches.points))
    weights = tukey_weights(residuals, gate) / (_DEVIATION**2 * _CORRELATION)
    equations.add(jacobian, residuals, weights)
    if final:
        across = motion_jacobian(matches.points, view.pixel_gradient(-dv, du, matches.points))
        equations.add_spurious(across, weights * _DIRECTION_DEVIATION**2)


def render_depth(surface: OrientedPoints, view: PosedView) -> np.ndarray | None:
    """Renders the model's depth (h, w) float32 [m], each surface point as a square.

    Empty pixels get a depth behind the object. Returns None if the view shows fewer than 30 points
    that face the camera.
    """
    facing = np.einsum("mi,mi->m", surface.normals, view.eye - surface.points) > 0.0
    points_C = view.to_camera(surface.points[facing])
    u, v = view.window.project(points_C)
    u, v = np.rint(u).astype(np.intp), np.rint(v).astype(np.intp)
    height, width = view.window.depth.shape
    z = points_C[:, 2]
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (z > 0.05)
    if np.count_nonzero(inside) < 30:
        return None
    u, v, z = u[inside], v[inside], z[inside].astype(np.float32)
    rendering = np.full((height, width), z.max() + np.float32(_FAR), dtype=np.float32)
    far_to_near = np.argsort(-z)
    rendering[v[far_to_near], u[far_to_near]] = z[far_to_near]
    return cv2.erode(rendering, square_kernel(_SPLAT), borderType=cv2.BORDER_REPLICATE)


def _outline(rendering: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the pixels u, v (K,) on the near side of the rendering's depth steps."""
    steps = cv2.dilate(rendering, square_kernel(1)) - rendering > _MODEL_JUMP
    border = SEARCH_REACH + 1
    v, u = np.nonzero(steps[border:-border, border:-border])
    chosen = evenly_spaced(len(u), _MAX_EDGES)
    return u[chosen] + border, v[chosen] + border


def _outward(rendering: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the unit direction du, dv (K,) of increasing depth at pixels of the outline."""
    smooth = cv2.GaussianBlur(rendering, (0, 0), 2.0)
    gu = (smooth[v, u + 1] - smooth[v, u - 1]).astype(float)
    gv = (smooth[v + 1, u] - smooth[v - 1, u]).astype(float)
    length = np.maximum(np.hypot(gu, gv), 1e-9)
    return gu / length, gv / length


def _search_edges(
    depth: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
    du: np.ndarray,
    dv: np.ndarray,
    z: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Searches the measured depth for the object's edge near each outline pixel.

    The search runs outward along (du, dv). Most pixels before the edge have the model's depth z
    [m]; most pixels after the edge are farther. Holes and flying pixels hardly shift the edge.

    Returns:
        found: (K,) bool, whether an edge was found.
        occluded: (K,) bool, whether something is in front of the model.
        shift: (K,) distance from the outline pixel outward to the edge [px].
    """
    steps = np.arange(-SEARCH_REACH, SEARCH_REACH + 1)
    uu = np.rint(u[:, None] + du[:, None] * steps).astype(np.intp)
    vv = np.rint(v[:, None] + dv[:, None] * steps).astype(np.intp)
    measured = depth[vv, uu]
    behind = measured - z[:, None]
    near = np.abs(behind) < _IMAGE_JUMP
    kinds = np.zeros((3, len(u), len(steps) + _INSIDE + _OUTSIDE), dtype=np.int8)
    kinds[0, :, _INSIDE:-_OUTSIDE] = near
    kinds[1, :, _INSIDE:-_OUTSIDE] = behind > _IMAGE_JUMP
    kinds[2, :, _INSIDE:-_OUTSIDE] = ~near & (behind < 0.0) & (measured > 0.0)
    balance = kinds[0] - kinds[1]
    last = np.cumsum(balance[:, _INSIDE:-_OUTSIDE], axis=1, dtype=np.int16).argmax(axis=1)
    rows = np.arange(len(u))[:, None]
    inner = kinds[:, rows, last[:, None] + np.arange(1, _INSIDE + 1)].sum(axis=2)
    outer = kinds[:, rows, last[:, None] + np.arange(_INSIDE + 1, _INSIDE + _OUTSIDE + 1)]
    outer = outer.sum(axis=2)
    occluded = inner[2] + outer[2] > 0
    found = (inner[0] >= 2) & (outer[1] >= 2) & (outer[0] <= 1) & ~occluded
    return found, occluded, steps[last] + 0.5
