"""What the first frame tells of the object beyond its surface: its colours, and where it is not.

The surface at a wrong pose may well agree with depth: a mug looks the same from all sides, but for
its handle. What is seen elsewhere then tells against the pose: a handle, known by its colours, that
is where, carried back to the first frame, a camera looked right through. What stood there from the
first, such as a rod that the object hangs on, tells nothing, whatever its colour.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import inverse
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.alignment.config import AppearanceConfig

_BINS = (16, 48, 48)  # of brightness and of the shares of red and of blue
_DARK = 24.0  # added to the sum of the channels, so that the hue of black is no noise [of 765]
_BESIDE = np.array([(v, u) for v in (-1, 0, 1) for u in (-1, 0, 1) if v or u]).T  # rows, columns


@dataclass(frozen=True, eq=False)
class ObservedPoints:
    """Points that are of the object by their colour, Q of them.

    Attributes:
        points: (Q, 3) float32 [m, world].
        weights: (Q,) float32 in (0, 1]: how surely they are the object's.
    """

    points: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True, eq=False)
class Background(SharedOnCopy):
    """What a camera saw around the object in the first frame.

    Attributes:
        nearest: (H, W) float32 least depth in and beside each pixel [m]; infinite where nothing was
            measured, or where the object was.
        farthest: (H, W) float32 the largest [m]; 0 there.
        X_WC: (4, 4) pose of the camera then.
    """

    nearest: np.ndarray
    farthest: np.ndarray
    X_WC: np.ndarray

    def shows(
        self, camera: CameraModel, rows: slice, columns: slice, depth: np.ndarray, error: float
    ) -> np.ndarray:
        """Returns which pixels (h, w) bool still show what stood there in the first frame.

        Args:
            camera: The camera now; nothing is known where it has moved.
            rows: Of the pixels that are asked about.
            columns: Of the same.
            depth: (h, w) what they measure now [m].
            error: Of depth [m].
        """
        if not np.array_equal(camera.X_WC, self.X_WC):
            return np.zeros(depth.shape, dtype=bool)
        nearest, farthest = self.nearest[rows, columns], self.farthest[rows, columns]
        return (depth >= nearest - np.float32(error)) & (depth <= farthest + np.float32(error))


@dataclass(frozen=True, eq=False)
class AppearanceModel(SharedOnCopy):
    """Colours and empty surroundings of an object, in its own frame.

    Attributes:
        sureness: `_BINS` float32: how surely a pixel of a colour shows the object, in [0, 1]; 0
            where it does so no more often than it shows something else.
        free_space_depth: (G, G, G) float32 distance into space that was seen to be empty [m]; 0 in
            all that may be the object.
        corner: Where that grid begins along each axis [m].
        spacing: Of the grid [m].
        backgrounds: What each camera saw around the object.
    """

    sureness: np.ndarray
    free_space_depth: np.ndarray
    corner: float
    spacing: float
    backgrounds: tuple[Background, ...]

    def free_space_depth_at(self, points_O: Sequence[np.ndarray]) -> np.ndarray:
        """Returns how far inside of empty space points are [m], given as x, y and z (...)."""
        size = len(self.free_space_depth)
        index = np.zeros(points_O[0].shape, dtype=np.int32)
        for coordinate in points_O:
            cell = (coordinate - np.float32(self.corner)) * np.float32(1.0 / self.spacing)
            index *= size
            index += np.clip(cell, 0, size - 1).astype(np.int32)
        return self.free_space_depth.ravel()[index]


def color_features(rgb: np.ndarray) -> np.ndarray:
    """Returns features (3, ...) float32 of colours (..., 3) uint8 that shading changes little.

    They are the brightness and the shares of red and of blue, each in [0, 1].
    """
    red, green, blue = np.moveaxis(rgb.astype(np.float32), -1, 0)
    total = red + green + blue + np.float32(_DARK)
    return np.stack([total * np.float32(1.0 / (765.0 + _DARK)), red / total, blue / total])


def likeness(rgb: np.ndarray, features: np.ndarray, config: AppearanceConfig) -> np.ndarray:
    """Returns how alike colours are, from 1 (the same) to -1 (surely others).

    Args:
        rgb: (M, 3) uint8.
        features: (3, M) those of the colours to compare with.
        config: How much colours differ that are not the same.
    """
    scale = np.array([config.brightness_deviation, *2 * [config.share_deviation]], np.float32)
    difference = (color_features(rgb) - features) / scale[:, None]
    return np.clip(1.5 - (difference * difference).sum(axis=0), -1.0, 1.0)


def learn_appearance(
    frame: MultiViewFrame,
    masks: Sequence[np.ndarray],
    X_WO: np.ndarray,
    radius: float,
    config: AppearanceConfig,
) -> AppearanceModel:
    """Learns colours and empty surroundings from the first frame.

    Args:
        frame: The first frame.
        masks: (H, W) bool for each view: where the object is.
        X_WO: (4, 4) pose of the object.
        radius: Of the object [m].
        config: Parameters.
    """
    reach = radius + config.surroundings
    size = int(np.ceil(2.0 * reach / config.spacing))
    axis = (np.arange(size) + 0.5) * config.spacing - reach
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    empty = np.zeros(len(grid), dtype=bool)
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        empty |= _seen_through(grid, camera, image.depth, X_WO, config)
    free_space_depth = distance_transform_edt(
        empty.reshape(size, size, size), sampling=config.spacing
    )
    return AppearanceModel(
        sureness=_sureness(frame, masks),
        free_space_depth=free_space_depth.astype(np.float32),
        corner=-reach,
        spacing=config.spacing,
        backgrounds=_backgrounds(frame, masks),
    )


def observe(
    appearance: AppearanceModel,
    frame: MultiViewFrame,
    centres_W: np.ndarray,
    reach: float,
    config: AppearanceConfig,
) -> ObservedPoints:
    """Returns points that are of the object by their colour, and were not there from the first.

    Args:
        appearance: How the object looks.
        frame: The views.
        centres_W: (n, 3) where the object may be [m, world].
        reach: How far from there [m].
        config: Parameters.
    """
    points, weights = [np.empty((0, 3), np.float32)], [np.empty(0, np.float32)]
    views = zip(frame.cameras, frame.images, appearance.backgrounds, strict=True)
    for camera, image, background in views:
        box = _box(camera, centres_W, reach)
        if box is None:
            continue
        u0, v0, u1, v1 = box
        stride = max(1, int(np.sqrt((u1 - u0) * (v1 - v0) / config.looked_at)))
        rows, columns = slice(v0, v1, stride), slice(u0, u1, stride)
        depth = image.depth[rows, columns]
        sure = _lookup(appearance.sureness, image.rgb[rows, columns])
        known = background.shows(camera, rows, columns, depth, config.clearance)
        v, u = np.nonzero((sure > config.min_sureness) & (depth > 0.0) & ~known)
        chosen = np.linspace(0, len(u) - 1, min(len(u), config.observed)).astype(np.intp)
        v, u = v[chosen], u[chosen]
        firm = _is_firm(image.depth, u0 + u * stride, v0 + v * stride, config)
        v, u = v[firm], u[firm]
        z = depth[v, u].astype(float)
        pixels = np.stack([(u0 + u * stride) * z, (v0 + v * stride) * z, z], axis=1)
        points_C = pixels @ np.linalg.inv(camera.K).T
        points_W = points_C @ camera.X_WC[:3, :3].T + camera.X_WC[:3, 3]
        points.append(points_W.astype(np.float32))
        weights.append(sure[v, u])
    return ObservedPoints(np.concatenate(points), np.concatenate(weights))


def _is_firm(
    depth: np.ndarray, u: np.ndarray, v: np.ndarray, config: AppearanceConfig
) -> np.ndarray:
    """Returns which pixels (q,) bool are part of a surface, and do not fly between two."""
    height, width = depth.shape
    rows = np.clip(v[:, None] + _BESIDE[0], 0, height - 1)
    columns = np.clip(u[:, None] + _BESIDE[1], 0, width - 1)
    alike = np.abs(depth[rows, columns] - depth[v, u][:, None]) < config.clearance
    return np.count_nonzero(alike, axis=1) >= config.min_neighbours


def contradiction(
    appearance: AppearanceModel,
    seen: ObservedPoints,
    poses: np.ndarray,
    radius: float,
    config: AppearanceConfig,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns how the observed points lie about the object at each of many poses (P, 4, 4).

    Returns:
        explained: (P,) weight of the points that may be the object's surface.
        vacant: (P,) weight of those that lie, near the object, in space that was seen empty.
    """
    X_OW = inverse(poses).astype(np.float32)
    R = np.ascontiguousarray(X_OW[:, :3, :3])
    points = (R @ seen.points.T + X_OW[:, :3, 3:]).transpose(1, 0, 2)
    near = (points * points).sum(axis=0) < np.float32(radius + config.margin) ** 2
    inside = appearance.free_space_depth_at(tuple(points)) - np.float32(config.tolerance)
    share = np.clip(inside * np.float32(1.0 / config.softness), 0.0, 1.0)
    vacant = np.where(near, share, 0.0)
    explained = np.where(near, 1.0 - share, 0.0)
    return explained @ seen.weights, vacant @ seen.weights


def _seen_through(
    points_O: np.ndarray,
    camera: CameraModel,
    depth: np.ndarray,
    X_WO: np.ndarray,
    config: AppearanceConfig,
) -> np.ndarray:
    """Returns which points (M,) bool a camera saw through, by the nearest depth around them."""
    infinite = np.where(depth > 0.0, depth, np.float32(np.inf))
    nearest = cv2.erode(infinite, np.ones((3, 3), np.uint8))
    X_CO = inverse(camera.X_WC) @ X_WO
    points_C = points_O @ X_CO[:3, :3].T + X_CO[:3, 3]
    z = np.maximum(points_C[:, 2], 1e-3)
    u, v = np.rint((points_C @ camera.K.T)[:, :2] / z[:, None]).astype(np.intp).T
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    measured = nearest[np.where(inside, v, 0), np.where(inside, u, 0)]
    return inside & np.isfinite(measured) & (z < measured - config.clearance)


def _backgrounds(frame: MultiViewFrame, masks: Sequence[np.ndarray]) -> tuple[Background, ...]:
    """Returns what the first frame shows around the object."""
    around = np.ones((3, 3), np.uint8)
    backgrounds = []
    for camera, image, mask in zip(frame.cameras, frame.images, masks, strict=True):
        border = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
        depth = np.where(border, np.float32(0.0), image.depth)
        infinite = np.where(depth > 0.0, depth, np.float32(np.inf))
        backgrounds.append(
            Background(cv2.erode(infinite, around), cv2.dilate(depth, around), camera.X_WC)
        )
    return tuple(backgrounds)


def _sureness(frame: MultiViewFrame, masks: Sequence[np.ndarray]) -> np.ndarray:
    """Returns by colour how much oftener than not a pixel of the first frame shows the object."""
    own, other = np.zeros(_BINS, np.float32), np.zeros(_BINS, np.float32)
    for image, mask in zip(frame.images, masks, strict=True):
        # Pixels along the border are neither.
        beside = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
        own += _histogram(image.rgb[mask])
        other += _histogram(image.rgb[~beside])
    return np.clip((own - other) / (own + other + 1.0), 0.0, 1.0)


def _histogram(rgb: np.ndarray) -> np.ndarray:
    """Returns the counts of colours (M, 3) in bins, spread over the bins beside them."""
    counts = np.bincount(_bin(rgb), minlength=int(np.prod(_BINS))).reshape(_BINS)
    smooth = [cv2.GaussianBlur(layer.astype(np.float32), (0, 0), 1.0) for layer in counts]
    flat = np.stack(smooth).reshape(_BINS[0], -1)
    return cv2.GaussianBlur(flat, (1, 0), sigmaX=1e-3, sigmaY=1.0).reshape(_BINS)


def _bin(rgb: np.ndarray) -> np.ndarray:
    """Returns the bins (...) of colours (..., 3)."""
    index = np.zeros(rgb.shape[:-1], dtype=np.int32)
    for feature, bins in zip(color_features(rgb), _BINS, strict=True):
        index *= bins
        index += np.minimum((feature * bins).astype(np.int32), bins - 1)
    return index


def _lookup(sureness: np.ndarray, rgb: np.ndarray) -> np.ndarray:
    return sureness.ravel()[_bin(rgb)]


def _box(
    camera: CameraModel, centres_W: np.ndarray, reach: float
) -> tuple[int, int, int, int] | None:
    """Returns the pixels (u0, v0, u1, v1) around spheres, None where a camera does not see them."""
    centres_C = (centres_W - camera.X_WC[:3, 3]) @ camera.X_WC[:3, :3]
    z = centres_C[:, 2]
    centres_C, z = centres_C[z > reach], z[z > reach]
    if len(z) == 0:
        return None
    uv = (centres_C @ camera.K.T)[:, :2] / z[:, None]
    half = np.array([camera.K[0, 0], camera.K[1, 1]]) * (reach / z)[:, None]
    size = (camera.width, camera.height)
    u0, v0 = np.clip(np.floor((uv - half).min(axis=0)), 0, size).astype(int)
    u1, v1 = np.clip(np.ceil((uv + half).max(axis=0)), 0, size).astype(int)
    return None if u1 - u0 < 2 or v1 - v0 < 2 else (int(u0), int(v0), int(u1), int(v1))
