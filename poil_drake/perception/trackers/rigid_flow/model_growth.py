"""Adds surfaces that come into view to the model.

A pixel joins the model if it continues the known surface and if its point, moved back to where it
would have been in the first frame, was hidden there. The second test (space carving) keeps out
tables, fixtures and hands, because their points, moved back with the object, lie in free space.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.trackers.rigid_flow.alignment.contour_term import render_depth
from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import OrientedPoints
from poil_drake.perception.trackers.rigid_flow.appearance_model import color_features
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel, choose_points
from poil_drake.perception.trackers.rigid_flow.texture_patches import (
    HALF_WIDTH,
    MAX_PATCHES,
    facing_patches,
    take_patches,
)
from poil_drake.perception.trackers.rigid_flow.view_window import (
    PosedView,
    ViewSurface,
    ViewWindow,
    square_kernel,
    view_normals,
    view_surface,
)

_ROTATION = float(np.radians(10.0))  # turn after which a view needs a new keyframe [rad]
_TRAVEL = 0.03  # likewise [m]: where the object was before, something may have hidden it

_REACH = 12  # how far from the known surface new surface may lie in the image [px]
_SURROUNDINGS = 4  # known surface kept around new [px]: borders must not look like outliers
_DISTANCE = 0.02  # how far from the known surface new points may lie in space [m]
_KNOWN_ERROR = 0.006  # depth measured within this of the model is known surface [m]
_MIN_COSINE = 0.4  # between the new surface and the line of sight
_MAX_POINTS, _MAX_GROWTH = 7000, 2.5  # of the model, or times the points of the first frame
_PATCHES_PER_VIEW = 12  # texture patches taken from one view at a time
_TRUST = 0.2  # of new points and patches: those that join together share one pose error


@dataclass(frozen=True, eq=False)
class Keyframe(SharedOnCopy):
    """A view from which the model was learnt.

    Attributes:
        direction: (3,) unit vector from the object to the camera, in the object's frame.
        position: (3,) position of the object [m, world].
    """

    direction: np.ndarray
    position: np.ndarray

    @classmethod
    def at(cls, eye_O: np.ndarray, X_WO: np.ndarray) -> "Keyframe":
        """Returns the keyframe of a camera at eye_O (3,) or (4,) [m] and an object at X_WO."""
        return cls(eye_O[:3] / np.linalg.norm(eye_O[:3]), X_WO[:3, 3])


def needs_keyframe(new: Keyframe, keyframes: tuple[Keyframe, ...]) -> bool:
    """Returns whether a new view may show something that no keyframe shows."""
    nearest = np.cos(_ROTATION)
    return not any(
        new.direction @ old.direction > nearest
        and np.linalg.norm(new.position - old.position) < _TRAVEL
        for old in keyframes
    )


def grow_model(
    model: ObjectModel, windows: Sequence[ViewWindow], X_WO: np.ndarray, config: RigidFlowConfig
) -> ObjectModel:
    """Returns the model, extended by surface that some views show for the first time.

    Args:
        model: The model of the object.
        windows: The windows of the views to learn from.
        X_WO: (4, 4) pose of the object.
        config: Parameters.
    """
    surface, patches = model.surface, model.patches
    # The first frame may show more points of a large object.
    limit = max(_MAX_POINTS, int(_MAX_GROWTH * np.count_nonzero(surface.trust == 1.0)))
    tree = cKDTree(surface.points)
    for window in windows:
        view = window.at(X_WO)
        rendering = render_depth(surface, view)
        if rendering is None:
            continue
        covered = rendering < rendering.max()
        known = covered & (np.abs(window.surface - rendering) < _KNOWN_ERROR)
        reachable = _reachable(known, window.surface > 0.0)
        around = cv2.dilate((reachable & ~known).astype(np.uint8), square_kernel(_SURROUNDINGS))
        seen = view_surface(window, reachable & (around > 0))
        new = np.flatnonzero(_is_new(seen, rendering, window))
        points_O = view.to_object(seen.points[new])
        allowed = tree.query(points_O)[0] < _DISTANCE
        for reference in model.appearance.reference_views:
            allowed &= reference.allows(points_O, transform_points(X_WO, points_O))
        joining = OrientedPoints.make(
            points_O[allowed],
            seen.normals[new[allowed]] @ view.R_CO,
            color_features(seen.colors[new[allowed]]),
            _TRUST,
        )
        surface = surface.joined(joining, limit)
        known_normals = view_normals(window, known)
        usable = known & np.isfinite(known_normals[..., 0])
        usable &= ~_near_patches(model, view)
        taken = take_patches(view, usable, known_normals, count=_PATCHES_PER_VIEW, trust=_TRUST)
        patches = patches.joined(taken, MAX_PATCHES)
    if len(surface) == len(model.surface) and len(patches) == len(model.patches):
        return model
    aligned, support = choose_points(surface, config)
    return replace(model, surface=surface, aligned=aligned, support=support, patches=patches)


def _reachable(known: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """Returns which pixels (h, w) bool at most `_REACH` solid pixels connect to a known pixel."""
    reached, allowed = known.astype(np.uint8), solid.astype(np.uint8)
    for _ in range(_REACH):
        reached = cv2.dilate(reached, square_kernel(1)) & allowed
    return reached.astype(bool)


def _is_new(seen: ViewSurface, rendering: np.ndarray, window: ViewWindow) -> np.ndarray:
    """Returns which points (M,) bool of a view face the camera and are not yet in the model."""
    z = seen.points[:, 2]
    u, v = window.project(seen.points)
    height, width = rendering.shape
    u = np.clip(np.rint(u).astype(np.intp), 0, width - 1)
    v = np.clip(np.rint(v).astype(np.intp), 0, height - 1)
    slant = -np.einsum("mi,mi->m", seen.points, seen.normals)
    facing = slant > _MIN_COSINE * np.linalg.norm(seen.points, axis=1)
    return facing & (np.abs(z - rendering[v, u]) > _KNOWN_ERROR)


def _near_patches(model: ObjectModel, view: PosedView) -> np.ndarray:
    """Returns which pixels (h, w) bool are near the model's patches that face the camera."""
    facing = facing_patches(model.patches, view.eye)
    u, v = view.project(model.patches.centres[facing])
    near = np.zeros(view.window.depth.shape, dtype=bool)
    reach = 2 * HALF_WIDTH
    for x, y in zip(np.rint(u).astype(int), np.rint(v).astype(int), strict=True):
        near[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1] = True
    return near
