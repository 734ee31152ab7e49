"""What the tracker knows of the object: its surface and its texture, in the object's own frame."""

from dataclasses import dataclass, replace

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.geometry.depth_masks import erode_mask
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.geometry.sampling import farthest_point_sampling
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.alignment.config import ModelConfig
from poil_drake.perception.trackers.rigid_flow.alignment.contour_term import match_contour
from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import OrientedPoints
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import cross_rows
from poil_drake.perception.trackers.rigid_flow.appearance_model import (
    AppearanceModel,
    color_features,
    learn_appearance,
)
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.texture_patches import TexturePatches, take_patches
from poil_drake.perception.trackers.rigid_flow.view_surface import ViewSurface, view_surface
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow, make_window


@dataclass(frozen=True, eq=False)
class ObjectModel(SharedOnCopy):
    """The object in its own frame O, which is at the centroid of what was seen first.

    Attributes:
        points: (M, 3) surface points [m].
        normals: (M, 3) unit.
        colors: (M, 3) uint8 RGB.
        trust: (M,) how much each counts, in (0, 1]; less than 1 where the model grew.
        aligned: Those of them that enter the alignment.
        support: Those of them, spread evenly over the object, that tell how much of it is seen.
        patches: Texture.
        appearance: Its colours and where it is not.
        part_points: (N, 3) the points to report [m].
        contour_bias: How far outward of its rendered outline the object really ends [px].
        radius: Largest distance of a point from the origin [m].
    """

    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    trust: np.ndarray
    aligned: OrientedPoints
    support: OrientedPoints
    patches: TexturePatches
    appearance: AppearanceModel
    part_points: np.ndarray
    contour_bias: float
    radius: float


def build_model(
    frame: MultiViewFrame,
    query_points: np.ndarray,
    masks: tuple[np.ndarray, ...],
    config: RigidFlowConfig,
) -> tuple[ObjectModel, np.ndarray]:
    """Models the object from the first frame.

    Returns:
        The model, and X_WO (4, 4): the pose of its frame, whose axes are the world's.

    Raises:
        TrackingError: if too little of the object is seen.
    """
    surfaces: list[tuple[ViewWindow, ViewSurface]] = []
    for index, mask in enumerate(masks):
        window = _window_of_mask(frame, index, mask, config)
        if window is None:
            continue
        (u0, v0), (height, width) = window.corner, window.depth.shape
        inner = erode_mask(mask, config.model.erosion)[v0 : v0 + height, u0 : u0 + width]
        surfaces.append((window, view_surface(window, inner, config)))
    count = sum(len(surface.points) for _, surface in surfaces)
    if count < config.model.min_points:
        marked = [int(np.count_nonzero(mask)) for mask in masks]
        raise TrackingError(
            f"Only {count} surface points of the object are seen, but {config.model.min_points} "
            f"are needed; the masks mark {marked} pixels.",
            remedy="Check the masks and the depth images, or move a camera nearer.",
        )
    in_world = [(w.sight(np.eye(4)), surface) for w, surface in surfaces]
    points_W = np.concatenate([sight.to_object(surface.points) for sight, surface in in_world])
    normals = np.concatenate([surface.normals @ sight.R_CO for sight, surface in in_world])
    colors = np.concatenate([surface.colors for _, surface in surfaces])
    origin = points_W.mean(axis=0)
    X_WO = make_transform(np.eye(3), origin)
    radius = float(np.linalg.norm(points_W - origin, axis=1).max())
    patches = TexturePatches.empty(config.texture)
    for window, surface in surfaces:
        taken = take_patches(
            window,
            X_WO,
            surface.usable,
            surface.normal_image,
            config.texture,
            count=config.texture.max_patches,
            trust=1.0,
        )
        patches = patches.joined(taken, config.texture.max_total)
    model = assemble_model(
        points_W - origin,
        normals,
        colors,
        np.ones(len(normals)),
        patches,
        appearance=learn_appearance(frame, masks, X_WO, radius, config.appearance),
        part_points=query_points - origin,
        contour_bias=0.0,
        config=config.model,
    )
    bias = _contour_bias(model, [window for window, _ in surfaces], X_WO, config)
    return replace(model, contour_bias=bias), X_WO


def assemble_model(
    points: np.ndarray,
    normals: np.ndarray,
    colors: np.ndarray,
    trust: np.ndarray,
    patches: TexturePatches,
    *,
    appearance: AppearanceModel,
    part_points: np.ndarray,
    contour_bias: float,
    config: ModelConfig,
) -> ObjectModel:
    """Returns the model of a surface of M points with what follows from it."""
    every = _oriented(points, normals, colors, trust)
    support = farthest_point_sampling(points, min(config.support_points, len(points)))
    return ObjectModel(
        points=points,
        normals=normals,
        colors=colors,
        trust=trust,
        aligned=every.select(_stable_choice(every.rows, config.aligned_points)),
        support=every.select(support),
        patches=patches,
        appearance=appearance,
        part_points=part_points,
        contour_bias=contour_bias,
        radius=float(np.linalg.norm(points, axis=1).max()),
    )


def _oriented(
    points: np.ndarray, normals: np.ndarray, colors: np.ndarray, trust: np.ndarray
) -> OrientedPoints:
    rows = np.hstack([cross_rows(points, normals), normals])
    offsets = np.einsum("mi,mi->m", points, normals)
    return OrientedPoints(points, normals, offsets, rows, trust, color_features(colors))


def _stable_choice(rows: np.ndarray, count: int) -> np.ndarray:
    """Chooses the points (of M, by index) that pin the pose down best.

    Half of the choice goes by leverage, the share of a point in what is known of the pose: the few
    points of a handle tell how far a cylinder has turned (cf. Gelfand et al. 2003, "Geometrically
    stable sampling for the ICP algorithm"). The other half is even.
    """
    if len(rows) <= count:
        return np.arange(len(rows))
    leverage = np.einsum("mi,mi->m", rows @ np.linalg.pinv(rows.T @ rows), rows)
    share = 0.5 * leverage / leverage.sum() + 0.5 / len(rows)
    # Systematic sampling: one point for each equal step of the summed shares.
    chosen = np.unique(np.searchsorted(np.cumsum(share), (np.arange(count) + 0.5) / count))
    return np.minimum(chosen, len(rows) - 1)


def _window_of_mask(
    frame: MultiViewFrame, index: int, mask: np.ndarray, config: RigidFlowConfig
) -> ViewWindow | None:
    """Returns the window around the masked pixels that have depth, None where there are few."""
    camera, image = frame.cameras[index], frame.images[index]
    v, u = np.nonzero(mask & (image.depth > 0.0))
    if len(u) < 3:
        return None
    z = image.depth[v, u].astype(float)
    pixels = np.stack([u * z, v * z, z], axis=1)
    points_C = pixels @ np.linalg.inv(camera.K).T
    points_W = points_C @ camera.X_WC[:3, :3].T + camera.X_WC[:3, 3]
    return make_window(index, camera, image, points_W, config.window)


def _contour_bias(
    model: ObjectModel, windows: list[ViewWindow], X_WO: np.ndarray, config: RigidFlowConfig
) -> float:
    """Measures, where the pose is known, how far the edges are from the rendered outline."""
    shifts = []
    for window in windows:
        matches = match_contour(model.points, model.normals, 0.0, window, X_WO, config.contour)
        if matches is not None:
            shifts.append(matches.displacements)
    found = np.concatenate(shifts) if shifts else np.empty(0)
    found = found[np.abs(found) < config.contour.search - 2]
    return float(np.median(found)) if found.size else 0.5
