"""Small patches of an object's texture, each with its place on the surface.

A patch is a square grid of points on the surface's tangent plane, with the grey levels that they
had when it was taken. Moved by the object's pose and projected, it foreshortens and turns as the
surface does.
"""

from dataclasses import dataclass, fields
from functools import lru_cache

import cv2
import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.sampling import farthest_point_sampling
from poil_drake.perception.trackers.rigid_flow.alignment.config import TextureConfig
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow


@dataclass(frozen=True, eq=False)
class TexturePatches(SharedOnCopy):
    """Patches of the surface, P of them with k samples each, in the object's frame.

    Attributes:
        centres: (P, 3) [m].
        normals: (P, 3) unit.
        samples: (P, k, 3) points of the grids [m].
        values: (P, k) float32 grey levels, a plane of grey taken off.
        sights: (P, 3) unit lines of sight along which they were taken.
        trust: (P,) weights in (0, 1].
    """

    centres: np.ndarray
    normals: np.ndarray
    samples: np.ndarray
    values: np.ndarray
    sights: np.ndarray
    trust: np.ndarray

    def __len__(self) -> int:
        return len(self.centres)

    @classmethod
    def empty(cls, config: TextureConfig) -> "TexturePatches":
        """Returns no patches."""
        k = (2 * config.half_width + 1) ** 2
        return cls(*(np.zeros(s) for s in ((0, 3), (0, 3), (0, k, 3), (0, k), (0, 3), (0,))))

    def select(self, index: np.ndarray) -> "TexturePatches":
        """Returns some of the patches, by index."""
        return TexturePatches(*(getattr(self, f.name)[index] for f in fields(self)))

    def joined(self, other: "TexturePatches", limit: int) -> "TexturePatches":
        """Returns these patches and others, the first `limit` of them."""
        return TexturePatches(
            *(
                np.concatenate([getattr(self, f.name), getattr(other, f.name)])[:limit]
                for f in fields(self)
            )
        )


def take_patches(
    window: ViewWindow,
    X_WO: np.ndarray,
    usable: np.ndarray,
    normals_C: np.ndarray,
    config: TextureConfig,
    *,
    count: int,
    trust: float,
) -> TexturePatches:
    """Takes patches where a view shows texture.

    Args:
        window: The view.
        X_WO: (4, 4) pose of the object.
        usable: (h, w) bool, pixels of the window that show the object's surface.
        normals_C: (h, w, 3) normals in the camera's frame, finite where usable.
        config: Parameters.
        count: How many to take at most.
        trust: Their weight.
    """
    reach = int(np.ceil(config.half_width * config.spacing))
    closed = cv2.morphologyEx(usable.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    inner = cv2.erode(closed, square, borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(bool)
    v, u = np.nonzero(inner & usable)
    if len(u) == 0:
        return TexturePatches.empty(config)
    values = sample_image(window.grey, *_grid(u, v, config))[..., 0] @ plane_remover(
        config.half_width
    )
    centres = window.unproject(u, v, window.depth[v, u].astype(float))
    normals = normals_C[v, u].astype(float)
    rays = centres / np.linalg.norm(centres, axis=1, keepdims=True)
    slant = -np.einsum("mi,mi->m", rays, normals)
    good = (values.std(axis=1) > config.min_contrast) & (slant > config.min_cosine)
    good[good] = _flat(window, u[good], v[good], centres[good], normals[good], config)
    chosen = np.flatnonzero(good)
    if len(chosen) == 0:
        return TexturePatches.empty(config)
    chosen = chosen[farthest_point_sampling(centres[chosen], min(count, len(chosen)))]
    u, v, centres, normals, rays = (x[chosen] for x in (u, v, centres, normals, rays))
    sight = window.sight(X_WO)
    return TexturePatches(
        sight.to_object(centres),
        normals @ sight.R_CO,
        sight.to_object(_on_plane(window, *_grid(u, v, config), centres, normals)),
        values[chosen],
        rays @ sight.R_CO,
        np.full(len(u), trust),
    )


def facing_patches(patches: TexturePatches, eye: np.ndarray, config: TextureConfig) -> np.ndarray:
    """Returns which patches (P,) bool face a camera about as they did when they were taken."""
    to_eye = eye - patches.centres
    distance = np.linalg.norm(to_eye, axis=1)
    slant = np.einsum("pi,pi->p", patches.normals, to_eye)
    turned = -np.einsum("pi,pi->p", patches.sights, to_eye)
    return (slant > config.min_cosine * distance) & (turned > config.min_view_cosine * distance)


def sample_image(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Returns an image (h, w, c) at places (P, k), interpolated: (P, k, c)."""
    return cv2.remap(image, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)


@lru_cache(maxsize=8)
def plane_remover(half_width: int) -> np.ndarray:
    """Returns the projector (k, k) float32 that takes the best plane off a grid of samples."""
    steps = np.arange(-half_width, half_width + 1, dtype=float)
    grid_u, grid_v = np.meshgrid(steps, steps)
    basis = np.stack([np.ones(grid_u.size), grid_u.ravel(), grid_v.ravel()], axis=1)
    remover = (np.eye(grid_u.size) - basis @ np.linalg.pinv(basis)).astype(np.float32)
    remover.flags.writeable = False
    return remover


def _on_plane(
    window: ViewWindow, u: np.ndarray, v: np.ndarray, centres: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Returns where lines of sight (P, k) meet the tangent planes (P,): (P, k, 3) in the camera."""
    rays = window.unproject(u, v, np.ones(u.shape))
    offsets = np.einsum("pi,pi->p", normals, centres)
    return rays * (offsets[:, None] / np.einsum("pki,pi->pk", rays, normals))[..., None]


def _flat(
    window: ViewWindow,
    u: np.ndarray,
    v: np.ndarray,
    centres: np.ndarray,
    normals: np.ndarray,
    config: TextureConfig,
) -> np.ndarray:
    """Returns which patches (P,) bool lie on a flat piece of surface: not on a rim or a handle."""
    grid_u, grid_v = _grid(u, v, config)
    z = _on_plane(window, grid_u, grid_v, centres, normals)[..., 2]
    measured = window.depth[np.rint(grid_v).astype(np.intp), np.rint(grid_u).astype(np.intp)]
    near = np.abs(measured - z) < config.max_bulge
    return (near | (measured == 0.0)).mean(axis=1) > 0.9


def _grid(u: np.ndarray, v: np.ndarray, config: TextureConfig) -> tuple[np.ndarray, np.ndarray]:
    """Returns the pixel coordinates (P, k) of the samples around pixels (P,)."""
    steps = np.arange(-config.half_width, config.half_width + 1) * config.spacing
    grid_u, grid_v = np.meshgrid(steps, steps)
    return u[:, None] + grid_u.ravel(), v[:, None] + grid_v.ravel()
