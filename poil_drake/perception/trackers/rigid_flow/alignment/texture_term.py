"""The texture term: patches of the surface against the image.

Patches are moved by the object's pose, projected, and compared with the current image. They
therefore remain comparable over large rotations, and errors do not accumulate from frame to frame.
To remove the effect of shading, the best-fitting plane of grey levels is subtracted from the patch
and from the image, and their contrasts are matched.

First each patch is searched for near its projection, as in optical flow, which copes with poses
that are several pixels off. Then grey levels are compared directly, which is more precise.
"""

from dataclasses import dataclass

import numpy as np

from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    huber_weights,
    motion_jacobian,
    tukey_weights,
)
from poil_drake.perception.trackers.rigid_flow.texture_patches import (
    HALF_WIDTH,
    PLANE_REMOVER,
    TexturePatches,
    facing_patches,
    sample_image,
)
from poil_drake.perception.trackers.rigid_flow.view_window import PosedView

_MAX_SHOWN = 60  # patches of a view that are used, the most trusted first
_MAX_DEPTH_ERROR = 0.01  # where depth differs by more, a patch is occluded [m]

_SEARCH_REACH = 3  # samples searched to each side
_FOUND_CORRELATION = 0.7  # with the image, above which a patch counts as found
_FLOW_DEVIATION = 1.0  # of the place where a patch is found [px]
_FLOW_GATE = 6.0  # a patch found farther from its projection does not count [px]

_DEVIATION = 3.0  # of a residual [grey levels]
_CORRELATION = 10.0  # residuals that count as one, since their errors are correlated
_CONTRAST_LIMITS = (0.5, 2.0)  # how much a patch's contrast may change with the light


@dataclass(frozen=True, eq=False)
class PatchMatches:
    """K patches that were found in a view.

    Attributes:
        centres: (K, 3) centres of the patches [m, object].
        targets: (K, 2) window coordinates at which the centres were found [px].
        tensor: (K, 2, 2) structure tensors of the image at the patches, scaled to trace 1.
        trust: (K,) weights in (0, 1].
    """

    centres: np.ndarray
    targets: np.ndarray
    tensor: np.ndarray
    trust: np.ndarray


def match_patches(patches: TexturePatches, view: PosedView) -> PatchMatches | None:
    """Searches for each patch near its projection in the image.

    Args:
        patches: Patches that the view shows.
        view: The view. Its pose may place the patches several pixels off.

    Returns:
        The matches, or None if there are fewer than 3.
    """
    if len(patches) == 0:
        return None
    half, reach = HALF_WIDTH, _SEARCH_REACH
    side, wide = 2 * half + 1, 2 * (half + reach) + 1
    u, v = view.project(patches.samples)
    # The patch's grid at this pose, extended on all sides.
    centre = side * side // 2
    du_i, dv_i = (x[:, centre + 1] - x[:, centre] for x in (u, v))
    du_j, dv_j = (x[:, centre + side] - x[:, centre] for x in (u, v))
    steps = np.arange(-half - reach, half + reach + 1)
    j, i = np.meshgrid(steps, steps, indexing="ij")
    wide_u = u[:, centre, None] + du_i[:, None] * i.ravel() + du_j[:, None] * j.ravel()
    wide_v = v[:, centre, None] + dv_i[:, None] * i.ravel() + dv_j[:, None] * j.ravel()
    sampled = sample_image(view.window.grey, wide_u, wide_v).reshape(len(u), wide, wide, 3)
    views = np.lib.stride_tricks.sliding_window_view(sampled[..., 0], (side, side), axis=(1, 2))
    views = views.reshape(len(u), (2 * reach + 1) ** 2, side * side)
    views = views @ PLANE_REMOVER
    reference = patches.values / np.linalg.norm(patches.values, axis=1, keepdims=True)
    length = np.sqrt(np.einsum("psk,psk->ps", views, views)) + np.float32(1e-3)
    scores = np.einsum("psk,pk->ps", views, reference) / length
    best = scores.argmax(axis=1)
    row, column = best // (2 * reach + 1) - reach, best % (2 * reach + 1) - reach
    good = scores[np.arange(len(u)), best] > _FOUND_CORRELATION
    good &= (np.abs(row) < reach) & (np.abs(column) < reach)
    if np.count_nonzero(good) < 3:
        return None
    inner = slice(reach, reach + side)
    gradients = sampled[good][:, inner, inner, 1:].reshape(-1, side * side, 2).astype(float)
    tensor = np.einsum("pka,pkb->pab", gradients, gradients)
    tensor /= np.trace(tensor, axis1=1, axis2=2)[:, None, None] + 1e-9
    found_u = u[:, centre] + (column * du_i + row * du_j)
    found_v = v[:, centre] + (column * dv_i + row * dv_j)
    targets = np.stack([found_u, found_v], axis=1)[good]
    return PatchMatches(patches.centres[good], targets, tensor, patches.trust[good])


def add_flow_term(equations: NormalEquations, matches: PatchMatches, view: PosedView) -> None:
    """Adds the distances in the image from each patch to where it was found, as residuals."""
    places = np.stack(view.project(matches.centres), axis=1)
    residuals = matches.targets - places
    weights = tukey_weights(np.linalg.norm(residuals, axis=1), _FLOW_GATE)
    weights *= matches.trust / _FLOW_DEVIATION**2
    tensor = matches.tensor * weights[:, None, None]
    pull = np.einsum("pab,pb->pa", tensor, residuals)
    _add_patches(equations, matches.centres, tensor, pull, view)


def add_texture_term(
    equations: NormalEquations,
    patches: TexturePatches,
    view: PosedView,
    min_correlation: float,
) -> None:
    """Adds the differences in grey level between patches and the image, as residuals.

    Args:
        equations: The equations to add to.
        patches: Patches that the view shows.
        view: The view.
        min_correlation: Patches whose correlation with the image is lower are left out.
    """
    if len(patches) == 0:
        return
    u, v = view.project(patches.samples)
    sampled = sample_image(view.window.grey, u, v).transpose(2, 0, 1) @ PLANE_REMOVER
    current, gu, gv = sampled
    cross = np.einsum("pk,pk->p", current, patches.values)
    power = np.einsum("pk,pk->p", current, current) + 1e-6
    own_power = np.einsum("pk,pk->p", patches.values, patches.values)
    contrast = np.clip(cross / power, *_CONTRAST_LIMITS)
    residuals = patches.values - contrast[:, None] * current
    weights = huber_weights(residuals, 1.5 * _DEVIATION)
    usable = cross > min_correlation * np.sqrt(power * own_power)
    scale = usable * patches.trust / (_DEVIATION**2 * _CORRELATION)
    weights *= scale[:, None]
    # All samples of a patch share its centre's derivative by the pose, so sum them first.
    weighted_u, weighted_v = weights * gu, weights * gv
    tensor = np.empty((len(patches), 2, 2))
    tensor[:, 0, 0] = np.einsum("pk,pk->p", weighted_u, gu)
    tensor[:, 0, 1] = tensor[:, 1, 0] = np.einsum("pk,pk->p", weighted_u, gv)
    tensor[:, 1, 1] = np.einsum("pk,pk->p", weighted_v, gv)
    pull = np.empty((len(patches), 2))
    pull[:, 0] = np.einsum("pk,pk->p", weighted_u, residuals)
    pull[:, 1] = np.einsum("pk,pk->p", weighted_v, residuals)
    tensor *= (contrast**2)[:, None, None]
    pull *= contrast[:, None]
    _add_patches(equations, patches.centres, tensor, pull, view)


def select_shown(patches: TexturePatches, view: PosedView) -> TexturePatches:
    """Returns at most `_MAX_SHOWN` patches that a view shows and nothing occludes."""
    shown = np.flatnonzero(facing_patches(patches, view.eye))
    if len(shown) > _MAX_SHOWN:
        trusted = np.argsort(-patches.trust[shown], kind="stable")
        shown = np.sort(shown[trusted[:_MAX_SHOWN]])
    points_C = view.to_camera(patches.samples[shown])
    u, v = view.window.project(points_C)
    height, width = view.window.depth.shape
    inside = ((u >= 1) & (v >= 1) & (u < width - 2) & (v < height - 2)).all(axis=1)
    inside &= (points_C[..., 2] > 0.05).all(axis=1)
    shown, u, v, z = shown[inside], u[inside], v[inside], points_C[inside][..., 2]
    measured = view.window.depth[np.rint(v).astype(np.intp), np.rint(u).astype(np.intp)]
    valid = measured > 0.0
    wrong = valid & (np.abs(measured - z) > _MAX_DEPTH_ERROR)
    unoccluded = (wrong.mean(axis=1) < 0.2) & (valid.mean(axis=1) > 0.5)
    return patches.select(shown[unoccluded])


def _add_patches(
    equations: NormalEquations,
    centres: np.ndarray,
    tensor: np.ndarray,
    pull: np.ndarray,
    view: PosedView,
) -> None:
    """Adds patches, each given by the normal equations of its displacement in the image.

    Args:
        equations: The equations to add to.
        centres: (P, 3) centres of the patches [m, object].
        tensor: (P, 2, 2) matrices of the displacements' normal equations.
        pull: (P, 2) right-hand sides of the displacements' normal equations.
        view: The view.
    """
    gradients = (view.pixel_gradient(1.0, 0.0, centres), view.pixel_gradient(0.0, 1.0, centres))
    jacobian = np.stack([motion_jacobian(centres, along) for along in gradients], axis=1)
    flat = jacobian.reshape(-1, 6)
    equations.H += flat.T @ (tensor @ jacobian).reshape(-1, 6)
    equations.b += pull.reshape(-1) @ flat
