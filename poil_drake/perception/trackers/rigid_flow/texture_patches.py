"""Small patches of the object's texture, each with its place on the surface.

A patch is a square grid of points on the surface's tangent plane, with the grey levels that the
points had when the patch was taken. To find its image, a patch is moved by the object's pose and
projected, so it turns and foreshortens as the surface does.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.geometry.point_cloud import farthest_point_sampling
from poil_drake.perception.trackers.rigid_flow.rows import Rows
from poil_drake.perception.trackers.rigid_flow.view_window import (
    PosedView,
    ViewWindow,
    square_kernel,
)

HALF_WIDTH = 2
"""A patch has 2 HALF_WIDTH + 1 samples on each side."""

MAX_PATCHES = 400
"""Largest number of patches of a model."""

_SPACING = 1.5  # of a patch's samples in the image that it is taken from [px]
_MIN_CONTRAST = 7.0  # standard deviation of grey after PLANE_REMOVER [grey levels of 255]
_MAX_BULGE = 0.003  # from the patch's plane [m]: rims and handles change shading as they turn
_MIN_COSINE = 0.35  # between the normal and the line of sight
_MIN_VIEW_COSINE = 0.5  # between the lines of sight now and when the patch was taken


@dataclass(frozen=True, eq=False)
class TexturePatches(Rows):
    """P patches of the surface with k samples each, in the object's frame.

    Attributes:
        centres: (P, 3) [m].
        normals: (P, 3) unit.
        samples: (P, k, 3) points of the patches' grids [m].
        values: (P, k) float32 grey levels less their best-fitting plane (see `PLANE_REMOVER`).
        sights: (P, 3) unit vectors from the camera to the patches when they were taken.
        trust: (P,) weights in (0, 1].
    """

    centres: np.ndarray
    normals: np.ndarray
    samples: np.ndarray
    values: np.ndarray
    sights: np.ndarray
    trust: np.ndarray

    @classmethod
    def empty(cls) -> "TexturePatches":
        """Returns an empty set of patches."""
        k = (2 * HALF_WIDTH + 1) ** 2
        return cls(*(np.zeros(s) for s in ((0, 3), (0, 3), (0, k, 3), (0, k), (0, 3), (0,))))


def take_patches(
    view: PosedView,
    usable: np.ndarray,
    normals_C: np.ndarray,
    *,
    count: int,
    trust: float,
) -> TexturePatches:
    """Takes patches from places where a view shows texture.

    Args:
        view: The view.
        usable: (h, w) bool, pixels of the window that show the object's surface.
        normals_C: (h, w, 3) normals in the camera's frame, finite where usable.
        count: Largest number of patches.
        trust: Weight that the patches get.
    """
    window = view.window
    reach = int(np.ceil(HALF_WIDTH * _SPACING))
    closed = cv2.morphologyEx(usable.astype(np.uint8), cv2.MORPH_CLOSE, square_kernel(1))
    inner = cv2.erode(
        closed, square_kernel(reach), borderType=cv2.BORDER_CONSTANT, borderValue=0
    ).astype(bool)
    v, u = np.nonzero(inner & usable)
    if len(u) == 0:
        return TexturePatches.empty()
    values = sample_image(window.grey, *_grid(u, v))[..., 0] @ PLANE_REMOVER
    centres = window.unproject(u, v, window.depth[v, u].astype(float))
    normals = normals_C[v, u].astype(float)
    rays = centres / np.linalg.norm(centres, axis=1, keepdims=True)
    slant = -np.einsum("mi,mi->m", rays, normals)
    good = (values.std(axis=1) > _MIN_CONTRAST) & (slant > _MIN_COSINE)
    good[good] = _is_flat(window, u[good], v[good], centres[good], normals[good])
    chosen = np.flatnonzero(good)
    if len(chosen) == 0:
        return TexturePatches.empty()
    chosen = chosen[farthest_point_sampling(centres[chosen], min(count, len(chosen)))]
    u, v, centres, normals, rays = (x[chosen] for x in (u, v, centres, normals, rays))
    return TexturePatches(
        view.to_object(centres),
        normals @ view.R_CO,
        view.to_object(_on_plane(window, *_grid(u, v), centres, normals)),
        values[chosen],
        rays @ view.R_CO,
        np.full(len(u), trust),
    )


def facing_patches(patches: TexturePatches, eye: np.ndarray) -> np.ndarray:
    """Returns which patches (P,) bool face a camera and were taken from a similar direction.

    Args:
        patches: The patches.
        eye: (3,) the camera's centre in the object's frame [m].
    """
    to_eye = eye - patches.centres
    distance = np.linalg.norm(to_eye, axis=1)
    slant = np.einsum("pi,pi->p", patches.normals, to_eye)
    turned = -np.einsum("pi,pi->p", patches.sights, to_eye)
    return (slant > _MIN_COSINE * distance) & (turned > _MIN_VIEW_COSINE * distance)


def sample_image(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Returns the values (P, k, c) of an image (h, w, c), interpolated at pixels u, v (P, k)."""
    return cv2.remap(image, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)


def _plane_remover() -> np.ndarray:
    steps = np.arange(-HALF_WIDTH, HALF_WIDTH + 1, dtype=float)
    grid_u, grid_v = np.meshgrid(steps, steps)
    basis = np.stack([np.ones(grid_u.size), grid_u.ravel(), grid_v.ravel()], axis=1)
    return (np.eye(grid_u.size) - basis @ np.linalg.pinv(basis)).astype(np.float32)


PLANE_REMOVER = _plane_remover()
"""The projector (k, k) float32 that subtracts the best-fitting plane from the grey levels of a
patch. Shading looks like a plane of grey levels; texture does not."""


def _on_plane(
    window: ViewWindow, u: np.ndarray, v: np.ndarray, centres: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Returns where the sight lines of pixels (P, k) meet the P planes: (P, k, 3) [m, camera]."""
    rays = window.unproject(u, v, np.ones(u.shape))
    offsets = np.einsum("pi,pi->p", normals, centres)
    return rays * (offsets[:, None] / np.einsum("pki,pi->pk", rays, normals))[..., None]


def _is_flat(
    window: ViewWindow, u: np.ndarray, v: np.ndarray, centres: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Returns which patches (P,) bool lie on flat surface, unlike those on a rim or a handle."""
    grid_u, grid_v = _grid(u, v)
    z = _on_plane(window, grid_u, grid_v, centres, normals)[..., 2]
    measured = window.depth[np.rint(grid_v).astype(np.intp), np.rint(grid_u).astype(np.intp)]
    near = np.abs(measured - z) < _MAX_BULGE
    return (near | (measured == 0.0)).mean(axis=1) > 0.9


def _grid(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the coordinates u and v, (P, k) each, of the samples around pixels (P,)."""
    steps = np.arange(-HALF_WIDTH, HALF_WIDTH + 1) * _SPACING
    grid_u, grid_v = np.meshgrid(steps, steps)
    return u[:, None] + grid_u.ravel(), v[:, None] + grid_v.ravel()
