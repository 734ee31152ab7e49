"""The model of the object that the tracker aligns, in the object's own frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.geometry.depth_image import erode_mask
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.point_cloud import farthest_point_sampling
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.alignment.contour_term import (
    SEARCH_REACH,
    match_contour,
)
from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import OrientedPoints
from poil_drake.perception.trackers.rigid_flow.appearance_model import (
    AppearanceModel,
    color_features,
    learn_appearance,
)
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.reference_view import make_reference_views
from poil_drake.perception.trackers.rigid_flow.texture_patches import (
    MAX_PATCHES,
    TexturePatches,
    take_patches,
)
from poil_drake.perception.trackers.rigid_flow.view_window import (
    PosedView,
    ViewSurface,
    ViewWindow,
    make_window,
    unproject_to_world,
    view_surface,
)

_EROSION = 1  # border removed from the object's masks, which are about that much too large [px]

_MIN_POINTS = 100  # surface points that a model needs
_PATCHES_PER_VIEW = 40  # texture patches taken from one view of the first frame


@dataclass(frozen=True, eq=False)
class ObjectModel(SharedOnCopy):
    """The object in its own frame O, whose origin is the centroid of what the first frame shows.

    Attributes:
        surface: The object's surface points. Points that the first frame shows have trust 1.
        aligned: The surface points that enter the alignment.
        support: Evenly spread surface points that measure how much of the object the views show.
        patches: The object's texture.
        appearance: The object's colours and what surrounded it in the first frame.
        part_points: (N, 3) the points to report [m].
        contour_bias: Distance from the model's rendered outline outward to the object's edge [px].
    """

    surface: OrientedPoints
    aligned: OrientedPoints
    support: OrientedPoints
    patches: TexturePatches
    appearance: AppearanceModel
    part_points: np.ndarray
    contour_bias: float

    @cached_property
    def radius(self) -> float:
        """The largest distance of a surface point from the origin [m]."""
        return float(np.linalg.norm(self.surface.points, axis=1).max())


def build_model(
    frame: MultiViewFrame,
    query_points: np.ndarray,
    masks: tuple[np.ndarray, ...],
    config: RigidFlowConfig,
) -> tuple[ObjectModel, np.ndarray]:
    """Returns the object's model and its pose X_WO (4, 4) in the first frame.

    In that pose, the axes of the object's frame are parallel to the world's.

    Args:
        frame: The first frame.
        query_points: (N, 3) the points to report [m, world].
        masks: (H, W) bool for each view: where the object is.
        config: Parameters.

    Raises:
        TrackingError: if the views show too little of the object.
    """
    surfaces: list[tuple[ViewWindow, ViewSurface]] = []
    for camera, image, mask in zip(frame.cameras, frame.images, masks, strict=True):
        v, u = np.nonzero(mask & (image.depth > 0.0))
        window = make_window(camera, image, unproject_to_world(camera, image.depth, u, v))
        if window is None:
            continue
        (u0, v0), (height, width) = window.corner, window.depth.shape
        inner = erode_mask(mask, _EROSION)[v0 : v0 + height, u0 : u0 + width]
        surfaces.append((window, view_surface(window, inner)))
    count = sum(len(seen.points) for _, seen in surfaces)
    if count < _MIN_POINTS:
        marked = [int(np.count_nonzero(mask)) for mask in masks]
        raise TrackingError(
            f"The views show only {count} surface points of the object, but {_MIN_POINTS} are "
            f"needed; the masks mark {marked} pixels.",
            remedy="Check the masks and the depth images, or move a camera nearer.",
        )
    in_world = [(window.at(np.eye(4)), seen) for window, seen in surfaces]
    points_W = np.concatenate([view.to_object(seen.points) for view, seen in in_world])
    normals = np.concatenate([seen.normals @ view.R_CO for view, seen in in_world])
    colors = np.concatenate([seen.colors for _, seen in surfaces])
    origin = points_W.mean(axis=0)
    X_WO = make_transform(np.eye(3), origin)
    radius = float(np.linalg.norm(points_W - origin, axis=1).max())
    surface = OrientedPoints.make(points_W - origin, normals, color_features(colors), 1.0)
    views = [window.at(X_WO) for window, _ in surfaces]
    patches = TexturePatches.empty()
    for view, (_, seen) in zip(views, surfaces, strict=True):
        taken = take_patches(
            view, seen.usable, seen.normal_image, count=_PATCHES_PER_VIEW, trust=1.0
        )
        patches = patches.joined(taken, MAX_PATCHES)
    reference_views = make_reference_views(frame, masks, X_WO)
    aligned, support = choose_points(surface, config)
    model = ObjectModel(
        surface=surface,
        aligned=aligned,
        support=support,
        patches=patches,
        appearance=learn_appearance(frame, masks, reference_views, radius),
        part_points=query_points - origin,
        contour_bias=_contour_bias(surface, views),
    )
    return model, X_WO


def choose_points(
    surface: OrientedPoints, config: RigidFlowConfig
) -> tuple[OrientedPoints, OrientedPoints]:
    """Returns the surface points to align and the support points of a model."""
    aligned = _stable_choice(surface.jacobian, config.aligned_points)
    support = farthest_point_sampling(surface.points, min(config.support_points, len(surface)))
    return surface.select(aligned), surface.select(support)


def _stable_choice(jacobian: np.ndarray, count: int) -> np.ndarray:
    """Returns indices of rows of a Jacobian (M, 6) that together determine the pose well.

    Half of them are chosen by leverage, a point's share of the information on the pose. The few
    points of a mug's handle, for example, determine how far the mug has turned (cf. Gelfand et al.
    2003, "Geometrically stable sampling for the ICP algorithm"). The other half is spread evenly.
    """
    if len(jacobian) <= count:
        return np.arange(len(jacobian))
    leverage = np.einsum("mi,mi->m", jacobian @ np.linalg.pinv(jacobian.T @ jacobian), jacobian)
    share = 0.5 * leverage / leverage.sum() + 0.5 / len(jacobian)
    # Systematic sampling: one point for each equal step of the cumulative shares.
    chosen = np.unique(np.searchsorted(np.cumsum(share), (np.arange(count) + 0.5) / count))
    return np.minimum(chosen, len(jacobian) - 1)


def _contour_bias(surface: OrientedPoints, views: list[PosedView]) -> float:
    """Returns the median distance [px] from the rendered outline outward to the edges in views."""
    matches = (match_contour(surface, 0.0, view) for view in views)
    shifts = np.concatenate([[], *(found.displacements for found in matches if found is not None)])
    shifts = shifts[np.abs(shifts) < SEARCH_REACH - 2]
    return float(np.median(shifts)) if shifts.size else 0.5
