"""What the first frame shows besides the object's shape: its colours and its surroundings."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.geometry.depth_image import project
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.free_space import (
    FreeSpaceGrid,
    ObservedPoints,
    map_free_space,
)
from poil_drake.perception.trackers.rigid_flow.reference_view import CLEARANCE, ReferenceView
from poil_drake.perception.trackers.rigid_flow.rows import evenly_spaced
from poil_drake.perception.trackers.rigid_flow.view_window import unproject_to_world

_BINS = (16, 48, 48)  # of brightness and of the shares of red and of blue
_DARK = 24.0  # added to the sum of the channels, so that the hue of black is not noise [of 765]
_BRIGHTNESS_DEVIATION = 0.6  # of one surface's brightness, which changes with the light
_SHARE_DEVIATION = 0.06  # of one surface's shares of red and of blue

_INSPECTED = 4096  # about how many pixels of the box around the object are inspected
_MAX_OBSERVED = 128  # pixels of a view that become observed points
_MIN_CONFIDENCE = 0.3  # of an observed pixel's colour
_MIN_NEIGHBOURS = 3  # of 8, on the same surface: at edges, depth lies between two surfaces
_NEIGHBOURS = np.array([(v, u) for v in (-1, 0, 1) for u in (-1, 0, 1) if v or u]).T


@dataclass(frozen=True, eq=False)
class AppearanceModel(SharedOnCopy):
    """The object's colours, and what surrounded it in the first frame.

    Attributes:
        color_confidence: Array of shape `_BINS`, float32 in [0, 1]: for each colour, the confidence
            that a pixel of this colour shows the object. It is 0 if the colour is no more frequent
            on the object than elsewhere.
        free_space: Where the object is known not to be.
        reference_views: The views of the first frame.
    """

    color_confidence: np.ndarray
    free_space: FreeSpaceGrid
    reference_views: tuple[ReferenceView, ...]


def color_features(rgb: np.ndarray) -> np.ndarray:
    """Returns features (..., 3) float32 of RGB colours (..., 3) uint8.

    The features are brightness and the shares of red and blue, all in [0, 1]. Shading hardly
    changes the shares.
    """
    red, green, blue = np.moveaxis(rgb.astype(np.float32), -1, 0)
    total = red + green + blue + np.float32(_DARK)
    return np.stack([total * np.float32(1.0 / (765.0 + _DARK)), red / total, blue / total], axis=-1)


def color_similarity(rgb: np.ndarray, features: np.ndarray) -> np.ndarray:
    """Returns the similarity of colours, from 1 (the same) to -1 (certainly different).

    Args:
        rgb: (M, 3) uint8.
        features: (M, 3) `color_features` of the colours to compare with.
    """
    scale = np.array([_BRIGHTNESS_DEVIATION, _SHARE_DEVIATION, _SHARE_DEVIATION], np.float32)
    difference = (color_features(rgb) - features) / scale
    return np.clip(1.5 - (difference * difference).sum(axis=-1), -1.0, 1.0)


def learn_appearance(
    frame: MultiViewFrame,
    masks: Sequence[np.ndarray],
    views: tuple[ReferenceView, ...],
    radius: float,
) -> AppearanceModel:
    """Learns colours and free space from the first frame.

    Args:
        frame: The first frame.
        masks: (H, W) bool for each view: where the object is.
        views: The reference views of that frame.
        radius: Radius of the object [m].
    """
    own, other = np.zeros(_BINS, np.float32), np.zeros(_BINS, np.float32)
    for image, mask, view in zip(frame.images, masks, views, strict=True):
        own += _histogram(image.rgb[mask])
        other += _histogram(image.rgb[~view.mask])
    confidence = np.clip((own - other) / (own + other + 1.0), 0.0, 1.0)
    return AppearanceModel(confidence, map_free_space(views, radius), views)


def observe(
    appearance: AppearanceModel, frame: MultiViewFrame, centres_W: np.ndarray, reach: float
) -> ObservedPoints:
    """Returns points that have the object's colours and are not background of the first frame.

    Args:
        appearance: The object's appearance.
        frame: The views.
        centres_W: (n, 3) positions where the object may be [m, world].
        reach: How far around each centre to search [m].
    """
    points, weights = [], []
    views = zip(frame.cameras, frame.images, appearance.reference_views, strict=True)
    for camera, image, reference in views:
        u0, v0, u1, v1 = _box(camera, centres_W, reach)
        stride = max(1, int(np.sqrt((u1 - u0) * (v1 - v0) / _INSPECTED)))
        window = slice(v0, v1, stride), slice(u0, u1, stride)
        depth = image.depth[window]
        confidence = appearance.color_confidence.ravel()[_bin(image.rgb[window])]
        background = reference.shows_background(camera, *window, depth)
        candidates = (confidence > _MIN_CONFIDENCE) & (depth > 0.0) & ~background
        v, u = np.nonzero(candidates)
        chosen = evenly_spaced(len(u), _MAX_OBSERVED)
        u, v = u[chosen], v[chosen]
        confidence = confidence[v, u]
        u, v = u0 + u * stride, v0 + v * stride
        firm = is_on_surface(image.depth, u, v)
        points.append(unproject_to_world(camera, image.depth, u[firm], v[firm]).astype(np.float32))
        weights.append(confidence[firm])
    return ObservedPoints(np.concatenate(points), np.concatenate(weights))


def is_on_surface(depth: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Returns which pixels (q,) bool have enough neighbours of about the same depth."""
    height, width = depth.shape
    rows = np.clip(v[:, None] + _NEIGHBOURS[0], 0, height - 1)
    columns = np.clip(u[:, None] + _NEIGHBOURS[1], 0, width - 1)
    same = np.abs(depth[rows, columns] - depth[v, u][:, None]) < CLEARANCE
    return np.count_nonzero(same, axis=1) >= _MIN_NEIGHBOURS


def _histogram(rgb: np.ndarray) -> np.ndarray:
    """Returns the number of colours (M, 3) in each bin, of shape `_BINS`, smoothed over bins."""
    counts = np.bincount(_bin(rgb), minlength=int(np.prod(_BINS))).reshape(_BINS)
    smooth = [cv2.GaussianBlur(layer.astype(np.float32), (0, 0), 1.0) for layer in counts]
    flat = np.stack(smooth).reshape(_BINS[0], -1)
    return cv2.GaussianBlur(flat, (1, 0), sigmaX=1e-3, sigmaY=1.0).reshape(_BINS)


def _bin(rgb: np.ndarray) -> np.ndarray:
    """Returns the flat index of the bin of each colour (..., 3)."""
    bins = np.array(_BINS)
    index = np.minimum((color_features(rgb) * bins.astype(np.float32)).astype(np.int32), bins - 1)
    return np.ravel_multi_index(tuple(np.moveaxis(index, -1, 0)), _BINS)


def _box(camera: CameraModel, centres_W: np.ndarray, reach: float) -> list[int]:
    """Returns pixel bounds [u0, v0, u1, v1] of balls of radius `reach`; empty if none is seen."""
    uv, z = project(centres_W, camera.K, camera.X_WC)
    uv, z = uv[z > reach], z[z > reach]
    if len(uv) == 0:
        return [0, 0, 0, 0]
    half = np.diag(camera.K)[:2] * (reach / z[:, None])
    corners = np.stack([np.floor((uv - half).min(axis=0)), np.ceil((uv + half).max(axis=0))])
    return np.clip(corners, 0, (camera.width, camera.height)).astype(int).ravel().tolist()
