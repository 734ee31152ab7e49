"""Coloured blocks on a table, seen by two cameras: rendered by intersecting rays with boxes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

WIDTH, HEIGHT = 160, 120
K = np.array([[180.0, 0.0, 79.5], [0.0, 180.0, 59.5], [0.0, 0.0, 1.0]])
EYES = {"left": (0.5, 0.25, 0.5), "right": (0.6, -0.3, 0.5)}

Block = tuple[Sequence[float], Sequence[float], tuple[int, int, int]]
"""Lower corner and upper corner [m, world], and colour."""

TABLE: Block = ((-1.0, -1.0, -0.1), (1.0, 1.0, 0.0), (130, 140, 130))
OBJECT: Block = ((-0.05, -0.05, 0.0), (0.05, 0.05, 0.12), (200, 40, 40))
HANDLE: Block = ((-0.01, 0.05, 0.02), (0.01, 0.10, 0.10), (200, 40, 40))
POST: Block = ((0.02, -0.22, 0.0), (0.06, -0.18, 0.20), (40, 60, 200))


@dataclass(frozen=True, eq=False)
class Scene:
    """A frame, and which block each pixel shows.

    Attributes:
        frame: The two views.
        shown: Name of the camera -> (H, W) int, index into the blocks.
        blocks: The blocks' names, in this order.
    """

    frame: MultiViewFrame
    shown: Mapping[str, np.ndarray]
    blocks: Sequence[str]

    def mask(self, camera: str, *blocks: str) -> np.ndarray:
        """Returns the pixels (H, W) bool of blocks in a view."""
        return np.isin(self.shown[camera], [self.blocks.index(name) for name in blocks])

    def box(self, camera: str, *blocks: str) -> tuple[float, ...]:
        """Returns (left, top, right, bottom) of blocks in a view [px]."""
        v, u = np.nonzero(self.mask(camera, *blocks))
        return tuple(float(x) for x in (u.min(), v.min(), u.max(), v.max()))

    def middle(self, camera: str, block: str) -> tuple[float, ...]:
        """Returns the pixel (u, v) of a block that is nearest to the middle of its pixels."""
        v, u = np.nonzero(self.mask(camera, block))
        best = np.argmin((u - u.mean()) ** 2 + (v - v.mean()) ** 2)
        return float(u[best]), float(v[best])


def look_at_table(eye: Sequence[float]) -> np.ndarray:
    """Returns the pose (4, 4) of a camera's optical frame that looks at the middle of the table."""
    forward = -np.array(eye) / np.linalg.norm(eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    X_WC = np.eye(4)
    X_WC[:3] = np.column_stack([right, np.cross(forward, right), forward, eye])
    return X_WC


def make_scene(blocks: Mapping[str, Block] | None = None, *, stamp: float = 0.0) -> Scene:
    """Renders a table with blocks, by default an object with a handle, and a post."""
    named = blocks or {"table": TABLE, "object": OBJECT, "handle": HANDLE, "post": POST}
    cameras = [CameraModel(n, WIDTH, HEIGHT, K, look_at_table(eye)) for n, eye in EYES.items()]
    images, shown = [], {}
    for camera in cameras:
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(K).T
        rays = rays @ camera.X_WC[:3, :3].T
        depths = np.stack([_depth(camera.X_WC[:3, 3], rays, block) for block in named.values()])
        nearest = depths.argmin(axis=0)
        depth = depths.min(axis=0)
        colors = np.array([block[2] for block in named.values()], dtype=np.uint8)
        rgb = np.where(np.isfinite(depth)[..., None], colors[nearest], np.uint8(220))
        images.append(RgbdImage(rgb, np.where(np.isfinite(depth), depth, 0.0), stamp))
        shown[camera.name] = np.where(np.isfinite(depth), nearest, -1)
    return Scene(MultiViewFrame(tuple(cameras), tuple(images)), shown, list(named))


def _depth(eye: np.ndarray, rays: np.ndarray, block: Block) -> np.ndarray:
    """Returns the depth (H, W) at which rays of unit depth enter a block [m]; inf if they miss."""
    with np.errstate(divide="ignore"):
        one, other = ((np.array(corner) - eye) / rays for corner in block[:2])
    enter, leave = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    return np.where((enter < leave) & (enter > 0.0), enter, np.inf)
