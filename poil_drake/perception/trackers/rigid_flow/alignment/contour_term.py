"""The model's outline against the edges of measured depth.

Depth alone says little about a motion along a surface: a plain cylinder may slide along its axis.
Its outline tells. Around the predicted outline, edges of depth are searched along the outline's
normal (RAPID, Harris and Stennett 1990, with depth edges in the place of grey ones), so that
neither texture nor contrast with the background is needed.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.perception.trackers.rigid_flow.alignment.config import ContourConfig
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    cross_rows,
    tukey_weights,
)
from poil_drake.perception.trackers.rigid_flow.view_window import Sight, ViewWindow

_FAR = 0.05  # how far behind the object the empty part of a rendering lies [m]
_INSIDE, _OUTSIDE = 3, 6  # pixels looked at on both sides of an edge


@dataclass(frozen=True, eq=False)
class ContourMatches:
    """Outline points of the model whose edge was found in a view, K of them.

    Attributes:
        points: (K, 3) outline points in the object's frame [m].
        directions: (K, 2) unit normals of the outline in the image, away from the object.
        targets: (K,) where along its direction each one's edge is [px].
        displacements: (K,) how far outward of the outline, as rendered, each edge is [px].
        searched: How many outline pixels were searched from and not hidden by anything.
        rendering: (h, w) float32 depth of the model as rendered [m].
    """

    points: np.ndarray
    directions: np.ndarray
    targets: np.ndarray
    displacements: np.ndarray
    searched: int
    rendering: np.ndarray


def match_contour(
    points_O: np.ndarray,
    normals_O: np.ndarray,
    bias: float,
    window: ViewWindow,
    X_WO: np.ndarray,
    config: ContourConfig,
) -> ContourMatches | None:
    """Finds the edges that belong to the model's outline.

    Args:
        points_O: (M, 3) model points [m].
        normals_O: (M, 3) their normals.
        bias: How far outward of its rendered outline the object really ends [px].
        window: The view.
        X_WO: (4, 4) pose of the object.
        config: Parameters.

    Returns:
        The matches, or None where there are too few.
    """
    sight = window.sight(X_WO)
    rendering = render_depth(points_O, normals_O, window, sight, config.splat)
    if rendering is None:
        return None
    u, v = _outline(rendering, config)
    if len(u) < 8:
        return None
    du, dv = _outward(rendering, u, v)
    z = rendering[v, u]
    found, hidden, shift = _search_edges(window.depth, u, v, du, dv, z, config)
    searched = int(np.count_nonzero(~hidden))
    u, v, du, dv, z, shift = (x[found] for x in (u, v, du, dv, z, shift))
    # The rendering covers `splat` more than the points; the surface ends about there.
    start_u, start_v = u - du * config.splat, v - dv * config.splat
    points = sight.to_object(window.unproject(start_u, start_v, z.astype(float)))
    targets = start_u * du + start_v * dv + shift - bias
    return ContourMatches(points, np.stack([du, dv], axis=1), targets, shift, searched, rendering)


def add_contour_term(
    equations: NormalEquations,
    matches: ContourMatches,
    window: ViewWindow,
    X_WO: np.ndarray,
    gate: float,
    config: ContourConfig,
    *,
    final: bool,
) -> None:
    """Adds the residuals of matches, which may have been found at another pose.

    If final, what is spurious in them is added, too.
    """
    sight = window.sight(X_WO)
    points_C = sight.to_camera(matches.points)
    u, v = window.project(points_C)
    du, dv = matches.directions[:, 0], matches.directions[:, 1]
    residuals = matches.targets - (du * u + dv * v)
    gradients = window.pixel_gradient(du, dv, points_C) @ sight.R_CO
    rows = np.hstack([cross_rows(matches.points, gradients), gradients])
    weights = tukey_weights(residuals, gate) / (config.deviation**2 * config.correlation)
    equations.add(rows, residuals, weights)
    if not final:
        return
    across = window.pixel_gradient(-dv, du, points_C) @ sight.R_CO
    equations.add_spurious(
        np.hstack([cross_rows(matches.points, across), across]),
        weights * config.direction_deviation**2,
    )


def render_depth(
    points_O: np.ndarray, normals_O: np.ndarray, window: ViewWindow, sight: Sight, splat: int
) -> np.ndarray | None:
    """Returns the model's depth (h, w) float32, each point a square; empty pixels lie behind."""
    facing = np.einsum("mi,mi->m", normals_O, sight.eye - points_O) > 0.0
    points_C = sight.to_camera(points_O[facing])
    u, v = window.project(points_C)
    u, v = np.rint(u).astype(np.intp), np.rint(v).astype(np.intp)
    height, width = window.depth.shape
    z = points_C[:, 2]
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (z > 0.05)
    if np.count_nonzero(inside) < 30:
        return None
    u, v, z = u[inside], v[inside], z[inside].astype(np.float32)
    rendering = np.full((height, width), z.max() + np.float32(_FAR), dtype=np.float32)
    far_to_near = np.argsort(-z)
    rendering[v[far_to_near], u[far_to_near]] = z[far_to_near]
    return cv2.erode(rendering, _square(splat), borderType=cv2.BORDER_REPLICATE)


def _outline(rendering: np.ndarray, config: ContourConfig) -> tuple[np.ndarray, np.ndarray]:
    """Returns pixels (u, v) on the near side of the rendering's depth steps."""
    steps = cv2.dilate(rendering, _square(1)) - rendering > config.model_jump
    border = config.search + 1
    v, u = np.nonzero(steps[border:-border, border:-border])
    if len(u) > config.max_edges:
        chosen = np.linspace(0, len(u) - 1, config.max_edges).astype(np.intp)
        u, v = u[chosen], v[chosen]
    return u + border, v + border


def _outward(rendering: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the direction (du, dv) of increasing depth at pixels of the outline."""
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
    config: ContourConfig,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Searches along each outline pixel's direction for where depth falls back.

    The edge is put where most pixels before it have the model's depth and most after it are
    farther, which holes and flying pixels disturb little.

    Returns:
        found: (K,) bool.
        hidden: (K,) bool, whether something stands in front.
        shift: (K,) place of the edge along the direction [px].
    """
    steps = np.arange(-config.search, config.search + 1)
    uu = np.rint(u[:, None] + du[:, None] * steps).astype(np.intp)
    vv = np.rint(v[:, None] + dv[:, None] * steps).astype(np.intp)
    measured = depth[vv, uu]
    behind = measured - z[:, None]
    near = np.abs(behind) < config.image_jump
    kinds = np.zeros((3, len(u), len(steps) + _INSIDE + _OUTSIDE), dtype=np.int8)
    kinds[0, :, _INSIDE:-_OUTSIDE] = near
    kinds[1, :, _INSIDE:-_OUTSIDE] = behind > config.image_jump
    kinds[2, :, _INSIDE:-_OUTSIDE] = ~near & (behind < 0.0) & (measured > 0.0)
    balance = kinds[0] - kinds[1]
    last = np.cumsum(balance[:, _INSIDE:-_OUTSIDE], axis=1, dtype=np.int16).argmax(axis=1)
    rows = np.arange(len(u))[:, None]
    inner = kinds[:, rows, last[:, None] + np.arange(1, _INSIDE + 1)].sum(axis=2)
    outer = kinds[:, rows, last[:, None] + np.arange(_INSIDE + 1, _INSIDE + _OUTSIDE + 1)]
    outer = outer.sum(axis=2)
    hidden = inner[2] + outer[2] > 0
    found = (inner[0] >= 2) & (outer[1] >= 2) & (outer[0] <= 1) & ~hidden
    return found, hidden, steps[last] + 0.5


def _square(radius: int) -> np.ndarray:
    return np.ones((2 * radius + 1, 2 * radius + 1), dtype=np.uint8)
