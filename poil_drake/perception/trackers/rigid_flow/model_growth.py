"""How surfaces that come into view join the model.

A pixel joins if it continues the known surface, and if the point that it shows, carried along by
the object, was hidden in the first frame. That last test (space carving) is what keeps out tables,
fixtures and hands: moved back with the object they would stand in what was seen to be empty.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import inverse
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.alignment.contour_term import render_depth
from poil_drake.perception.trackers.rigid_flow.config import GrowthConfig, RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel, assemble_model
from poil_drake.perception.trackers.rigid_flow.texture_patches import facing_patches, take_patches
from poil_drake.perception.trackers.rigid_flow.view_surface import (
    ViewSurface,
    view_normals,
    view_surface,
)
from poil_drake.perception.trackers.rigid_flow.view_window import Sight, ViewWindow

_SURROUNDINGS = 4  # pixels


@dataclass(frozen=True, eq=False)
class ReferenceView(SharedOnCopy):
    """What one camera saw in the first frame, and where the object was then.

    Attributes:
        depth: (H, W) float32 [m], 0 where invalid.
        nearest: (H, W) float32 nearest depth around each pixel [m], 0 where invalid.
        mask: (H, W) bool, the object and a border.
        K: (3, 3) intrinsic matrix [px].
        X_CW: (4, 4) the world in the camera.
        X_CO: (4, 4) the object in the camera, then.
    """

    depth: np.ndarray
    nearest: np.ndarray
    mask: np.ndarray
    K: np.ndarray
    X_CW: np.ndarray
    X_CO: np.ndarray

    def allows(self, points_O: np.ndarray, points_W: np.ndarray, clearance: float) -> np.ndarray:
        """Returns which points (M,) bool may belong to the object, for all that was seen.

        Args:
            points_O: (M, 3) in the object's frame [m].
            points_W: (M, 3) where they are now [m, world].
            clearance: How much nearer than measured a point must be to have been seen through [m].
        """
        z, nearest, depth, on_object = self._look(points_O, self.X_CO)
        seen_through = (nearest > 0.0) & (z < nearest - clearance)
        other_surface = (depth > 0.0) & (np.abs(z - depth) < clearance) & ~on_object
        z, _, depth, on_object = self._look(points_W, self.X_CW)
        background = (depth > 0.0) & (np.abs(z - depth) < clearance) & ~on_object
        return ~(seen_through | other_surface | background)

    def _look(self, points: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, ...]:
        """Returns z, nearest and own depth, and mask at the pixels of points; 0 outside."""
        points_C = points @ X[:3, :3].T + X[:3, 3]
        z = points_C[:, 2]
        uv = (points_C @ self.K.T)[:, :2] / np.maximum(z, 1e-3)[:, None]
        u, v = np.rint(uv).astype(np.intp).T
        height, width = self.depth.shape
        inside = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (z > 0.05)
        u, v = np.where(inside, u, 0), np.where(inside, v, 0)
        return (
            z,
            np.where(inside, self.nearest[v, u], 0.0),
            np.where(inside, self.depth[v, u], 0.0),
            inside & self.mask[v, u],
        )


@dataclass(frozen=True, eq=False)
class Keyframe(SharedOnCopy):
    """From where the model was learnt once.

    Attributes:
        sight: (3,) unit direction from the object to the camera, in the object's frame.
        position: (3,) where the object was [m, world].
    """

    sight: np.ndarray
    position: np.ndarray

    @classmethod
    def at(cls, eye_O: np.ndarray, X_WO: np.ndarray) -> "Keyframe":
        """Returns the keyframe of a camera at eye_O (3,) [m, object] with the object at X_WO."""
        return cls(eye_O[:3] / np.linalg.norm(eye_O[:3]), X_WO[:3, 3])


def needs_keyframe(new: Keyframe, keyframes: tuple[Keyframe, ...], config: GrowthConfig) -> bool:
    """Returns whether a view may show something that no keyframe so far has shown."""
    nearest = np.cos(config.rotation)
    return not any(
        new.sight @ old.sight > nearest
        and np.linalg.norm(new.position - old.position) < config.travel
        for old in keyframes
    )


def make_reference_views(
    frame: MultiViewFrame, masks: tuple[np.ndarray, ...], X_WO: np.ndarray
) -> tuple[ReferenceView, ...]:
    """Keeps what the first frame saw, for growth to compare with."""
    reference_views = []
    for camera, image, mask in zip(frame.cameras, frame.images, masks, strict=True):
        X_CW = inverse(camera.X_WC)
        infinite = np.where(image.depth > 0.0, image.depth, np.float32(np.inf))
        nearest = cv2.erode(infinite, _square(1))
        border = cv2.dilate(mask.astype(np.uint8), _square(2)).astype(bool)
        reference_views.append(
            ReferenceView(
                image.depth,
                np.where(np.isfinite(nearest), nearest, np.float32(0.0)),
                border,
                camera.K,
                X_CW,
                X_CW @ X_WO,
            )
        )
    return tuple(reference_views)


def grow_model(
    model: ObjectModel,
    reference_views: tuple[ReferenceView, ...],
    windows: Sequence[ViewWindow],
    X_WO: np.ndarray,
    config: RigidFlowConfig,
) -> ObjectModel:
    """Adds to the model what the views show of the object that it does not know yet.

    Args:
        model: The object.
        reference_views: What the first frame saw.
        windows: The views that are to be learnt from.
        X_WO: (4, 4) pose of the object.
        config: Parameters.
    """
    points, normals, trust, patches = model.points, model.normals, model.trust, model.patches
    colors = model.colors
    tree = cKDTree(points)
    for window in windows:
        sight = window.sight(X_WO)
        rendering = render_depth(points, normals, window, sight, config.contour.splat)
        if rendering is None:
            continue
        covered = rendering < rendering.max()
        known = covered & (np.abs(window.surface - rendering) < config.growth.known_error)
        reachable = _reach(known, window.surface > 0.0, config.growth.reach)
        # Known surface beside the new keeps borders from looking like outliers.
        around = cv2.dilate((reachable & ~known).astype(np.uint8), _square(_SURROUNDINGS))
        surface = view_surface(window, reachable & (around > 0), config)
        fresh = _is_new(surface, rendering, window, config)
        new_O = sight.to_object(surface.points[fresh])
        new_W = new_O @ X_WO[:3, :3].T + X_WO[:3, 3]
        allowed = tree.query(new_O)[0] < config.growth.distance
        for reference_view in reference_views:
            allowed &= reference_view.allows(new_O, new_W, config.growth.clearance)
        new_normals = surface.normals[fresh][allowed] @ sight.R_CO
        points = np.concatenate([points, new_O[allowed]])[: config.growth.max_points]
        normals = np.concatenate([normals, new_normals])[: config.growth.max_points]
        colors = np.concatenate([colors, surface.colors[fresh][allowed]])[: len(points)]
        trust = np.concatenate([trust, np.full(len(points) - len(trust), config.growth.trust)])
        known_normals = view_normals(window, known, config)
        usable = known & np.isfinite(known_normals[..., 0])
        _strike_out_patches(usable, model, window, sight, config)
        taken = take_patches(
            window,
            X_WO,
            usable,
            known_normals,
            config.texture,
            count=config.growth.max_patches,
            trust=config.growth.trust,
        )
        patches = patches.joined(taken, config.texture.max_total)
    if len(points) == len(model.points) and len(patches) == len(model.patches):
        return model
    return assemble_model(
        points,
        normals,
        colors,
        trust,
        patches,
        appearance=model.appearance,
        part_points=model.part_points,
        contour_bias=model.contour_bias,
        config=config.model,
    )


def _reach(known: np.ndarray, solid: np.ndarray, steps: int) -> np.ndarray:
    """Returns the pixels (h, w) bool reached from the known ones over pixels of solid surface."""
    reached, allowed = known.astype(np.uint8), solid.astype(np.uint8)
    for _ in range(steps):
        reached = cv2.dilate(reached, _square(1)) & allowed
    return reached.astype(bool)


def _is_new(
    surface: ViewSurface, rendering: np.ndarray, window: ViewWindow, config: RigidFlowConfig
) -> np.ndarray:
    """Returns which points (M,) bool of a view face it and are not on the model as rendered."""
    z = surface.points[:, 2]
    u, v = window.project(surface.points)
    height, width = rendering.shape
    u = np.clip(np.rint(u).astype(np.intp), 0, width - 1)
    v = np.clip(np.rint(v).astype(np.intp), 0, height - 1)
    slant = -np.einsum("mi,mi->m", surface.points, surface.normals)
    facing = slant > config.growth.min_cosine * np.linalg.norm(surface.points, axis=1)
    return facing & (np.abs(z - rendering[v, u]) > config.growth.known_error)


def _strike_out_patches(
    usable: np.ndarray,
    model: ObjectModel,
    window: ViewWindow,
    sight: Sight,
    config: RigidFlowConfig,
) -> None:
    """Clears `usable` (h, w) around the patches that this view could show already."""
    shown = facing_patches(model.patches, sight.eye, config.texture)
    u, v = window.project(sight.to_camera(model.patches.centres[shown]))
    taken = np.zeros(usable.shape, dtype=np.uint8)
    reach = 2 * config.texture.half_width
    for x, y in zip(np.rint(u).astype(int), np.rint(v).astype(int), strict=True):
        taken[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1] = 1
    usable &= taken == 0


def _square(radius: int) -> np.ndarray:
    return np.ones((2 * radius + 1, 2 * radius + 1), dtype=np.uint8)
