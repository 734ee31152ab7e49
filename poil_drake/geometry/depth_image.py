"""Depth images: units, reliable pixels, points, normals, and views from another camera."""

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError

# Lower bound of divisors; the quotients that it changes are not used.
_TINY = np.float32(1e-6)
# The 16-bit depth that means "too far" in the images of Drake and of saturated cameras.
_TOO_FAR = 65535

_PINHOLE_JUMP = 0.03  # as a share of the depth, between two pixels of one surface

COARSE_PIXEL = 0.002
"""A pixel that covers more than this is coarse [m]: handles and rims are only a few pixels wide. A
camera of 640 x 480 pixels has pixels of 1 to 1.5 mm at 0.65 m, one of 320 x 240 twice as large."""


@dataclass(frozen=True, kw_only=True)
class DepthMaskConfig:
    """Which pixels to remove from masks: borders, depth edges and unreliable depths.

    Where pixels are coarse (`COARSE_PIXEL`), `erosion` and `edge_margin` count as 0, because such
    borders would erase thin parts. Pixels at depth edges are removed nevertheless.

    Attributes:
        erosion: Width of the border removed from the mask [px]. Detectors' masks are about a pixel
            too large. A larger erosion may erase thin parts: at 0.65 m, a mug's handle is only
            about 7 px wide in an image of 640 x 480 pixels.
        relative_jump: Two neighbouring pixels are on different surfaces if their depths differ by
            more than this fraction of the smaller depth. 0.03 is 2 cm at 0.65 m.
        edge_margin: Pixels within this distance of a depth edge are removed too [px], because
            stereo depth there lies between the two surfaces.
        min_depth: Smallest reliable depth [m].
        max_depth: Largest reliable depth [m].
    """

    erosion: int = 1
    relative_jump: float = 0.03
    edge_margin: int = 1
    min_depth: float = 0.1
    max_depth: float = 3.0


def depth_in_metres(raw: np.ndarray, *, step: float) -> np.ndarray:
    """Returns depth [m] as float32, 0 where invalid.

    A float is invalid if it is not finite or not positive. An integer is invalid if it is 0 or
    65535 ("too far").

    Args:
        raw: Depth of any shape, float32 [m] or uint16 [steps].
        step: One step of integer depth [m].

    Raises:
        InvalidValueError: if `raw` has another type.
    """
    if raw.dtype == np.uint16:
        # The reciprocal of a millimetre is exact in float32.
        metres = np.divide(raw, np.float32(1.0 / step), dtype=np.float32)
        metres[raw == _TOO_FAR] = 0.0
        return metres
    if raw.dtype == np.float32:
        return np.where((raw > 0.0) & (raw < np.inf), raw, np.float32(0.0))
    raise InvalidValueError(
        f"Depth has the unsupported type {raw.dtype}.",
        remedy="Use 32-bit floats in metres, or unsigned 16-bit integers.",
    )


def erode_mask(mask: np.ndarray, pixels: int) -> np.ndarray:
    """Returns a mask (H, W) without its outermost `pixels` pixels, as bool.

    The image's border does not count as a border of the mask.
    """
    return cv2.erode(mask.astype(np.uint8), _disc(pixels)).astype(bool)


def depth_edges(depth: np.ndarray, relative_jump: float) -> np.ndarray:
    """Returns which pixels lie next to a jump in depth, on either side of it.

    Args:
        depth: (H, W) depth [m]; 0, NaN and infinity are invalid and cause no edge.
        relative_jump: Neighbouring depths that differ by more than this fraction of the smaller
            depth form a jump.

    Returns:
        (H, W) bool.
    """
    z = np.where(np.isfinite(depth) & (depth > 0.0), depth, 0.0).astype(np.float32)
    edges = np.zeros(z.shape, dtype=bool)
    for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        a, b = z[first], z[second]
        nearer = np.minimum(a, b)
        jump = (np.abs(a - b) > np.float32(relative_jump) * nearer) & (nearer > 0.0)
        edges[first] |= jump
        edges[second] |= jump
    return edges


def pixel_size(mask: np.ndarray, depth: np.ndarray, K: np.ndarray) -> float:
    """Returns the width [m] that a pixel covers at the median depth of a mask; NaN if it has none.

    Args:
        mask: (H, W) bool.
        depth: (H, W) depth [m]; 0, NaN and infinity are invalid.
        K: (3, 3) intrinsic matrix [px].
    """
    z = depth[mask & np.isfinite(depth) & (depth > 0.0)]
    return float(np.median(z) / K[0, 0]) if z.size else np.nan


def clean_mask(
    mask: np.ndarray, depth: np.ndarray, K: np.ndarray, config: DepthMaskConfig
) -> np.ndarray:
    """Returns a mask (H, W) bool without its border, unreliable depths and depth edges.

    Args:
        mask: (H, W) bool, the mask to clean.
        depth: (H, W) depth [m]; 0, NaN and infinity are invalid.
        K: (3, 3) intrinsic matrix [px].
        config: What to remove.

    Raises:
        InvalidValueError: if the mask and the depth image differ in shape.
    """
    if mask.shape != depth.shape:
        raise InvalidValueError(
            f"clean_mask() got a mask of shape {mask.shape} for depth of shape {depth.shape}.",
            remedy="Pass a mask and a depth image of the same shape.",
        )
    edges = depth_edges(depth, config.relative_jump).astype(np.uint8)
    coarse = pixel_size(mask, depth, K) > COARSE_PIXEL
    erosion, margin = (0, 0) if coarse else (config.erosion, config.edge_margin)
    edges = cv2.dilate(edges, _disc(margin)).astype(bool)
    reliable = (depth >= config.min_depth) & (depth <= config.max_depth)
    return erode_mask(mask, erosion) & reliable & ~edges


def unproject(depth: np.ndarray, K: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unprojects masked pixels of a depth image to points in the camera's frame.

    Args:
        depth: (H, W) depth along the optical axis [m]; 0, NaN and infinity are invalid.
        K: (3, 3) intrinsic matrix [px]; pixel centres are at integer coordinates.
        mask: (H, W) bool, the pixels to unproject.

    Returns:
        points_C: (M, 3) [m, optical frame], in row-major order of the valid pixels.
        pixels: (M, 2) int, (u, v) of each point.
    """
    v, u = np.nonzero(mask & np.isfinite(depth) & (depth > 0.0))
    z = depth[v, u].astype(float)
    x = (u - K[0, 2] - K[0, 1] * (v - K[1, 2]) / K[1, 1]) / K[0, 0]
    y = (v - K[1, 2]) / K[1, 1]
    return np.column_stack([x * z, y * z, z]), np.column_stack([u, v])


def project(points_W: np.ndarray, K: np.ndarray, X_WC: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Projects points in the world into a camera's image.

    Args:
        points_W: (..., 3) [m, world].
        K: (3, 3) intrinsic matrix [px].
        X_WC: (4, 4) pose of the optical frame in the world [m].

    Returns:
        uv: (..., 2) pixel coordinates, which may be outside the image; NaN behind the camera.
        z: Depth of each point along the optical axis [m]; negative behind the camera.
    """
    points_C = (np.asarray(points_W, dtype=float) - X_WC[:3, 3]) @ X_WC[:3, :3]
    z = points_C[..., 2]
    homogeneous = points_C @ K.T
    divisor = np.where(z > 0.0, z, np.nan)[..., None]
    return homogeneous[..., :2] / divisor, z


def register_depth(
    depth: np.ndarray,
    K_D: np.ndarray,
    K_C: np.ndarray,
    *,
    X_CD: np.ndarray,
    size: tuple[int, int],
) -> np.ndarray:
    """Returns depth in the view of another camera, e.g. that of a colour camera beside it.

    The surface of each pixel is cut into a grid that is finer than the pixels of the new view, so
    that no background shows through. Where several surfaces fall on a pixel, the nearest counts.
    Single pixels that stay empty between two pixels of one surface get their mean depth. Pixels
    that the depth camera does not see are 0.

    Args:
        depth: (H, W) depth along the optical axis of the depth camera D [m]; 0, NaN and infinity
            are invalid.
        K_D: (3, 3) intrinsic matrix of D [px].
        K_C: (3, 3) intrinsic matrix of the new view C [px].
        X_CD: (4, 4) pose of D's optical frame in C's [m].
        size: Height and width of the new view [px].

    Returns:
        (height, width) float32 depth along the optical axis of C [m]; 0 where it is unknown.
    """
    height, width = size
    grid = int(max(K_C[0, 0] / K_D[0, 0], K_C[1, 1] / K_D[1, 1])) + 1
    offsets = (np.arange(grid) + 0.5) / grid - 0.5
    v, u = np.nonzero(np.isfinite(depth) & (depth > 0.0))
    z = depth[v, u].astype(float)
    # The homogeneous pixel of C is z A (u, v, 1) + b.
    A, b = K_C @ X_CD[:3, :3] @ np.linalg.inv(K_D), K_C @ X_CD[:3, 3]
    registered = np.full(height * width, np.inf)
    for du, dv in product(offsets, offsets):
        x, y, z_C = (
            z * (row[0] * (u + du) + row[1] * (v + dv) + row[2]) + shift
            for row, shift in zip(A, b, strict=True)
        )
        divisor = np.where(z_C > 0.0, z_C, np.nan)
        column, row = np.rint(x / divisor), np.rint(y / divisor)
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        at = (row[inside] * width + column[inside]).astype(np.intp)
        np.minimum.at(registered, at, z_C[inside])
    registered[np.isinf(registered)] = 0.0
    return _fill_pinholes(registered.reshape(size).astype(np.float32))


def _fill_pinholes(depth: np.ndarray) -> np.ndarray:
    """Returns depth (H, W) in which single empty pixels get the mean of opposite neighbours."""
    filled = depth.copy()
    around = np.pad(depth, 1)
    for first, second in (
        (around[1:-1, :-2], around[1:-1, 2:]),
        (around[:-2, 1:-1], around[2:, 1:-1]),
    ):
        nearer = np.minimum(first, second)
        same = (nearer > 0.0) & (np.abs(first - second) <= _PINHOLE_JUMP * nearer)
        hole = same & (filled == 0.0)
        filled[hole] = 0.5 * (first + second)[hole]
    return filled


def depth_normals(
    depth: np.ndarray,
    K: np.ndarray,
    *,
    step: int = 1,
    smoothing: int = 0,
    relative_jump: float = 0.03,
) -> np.ndarray:
    """Returns unit surface normals of a depth image, facing the camera.

    A normal is the cross product of central differences of the unprojected points, which is exact
    for planes. Let z- and z+ be the depths at s pixels to either side of a pixel, and let
    g = (z+ - z-) / (z+ + z-) / s along each image axis. The product is then parallel to
    (fx gu, fy gv, -1 - (u - cx) gu - (v - cy) gv), so the points need not be computed.

    Args:
        depth: (H, W) depth along the optical axis [m]; 0, NaN and infinity are invalid.
        K: (3, 3) intrinsic matrix [px], without skew.
        step: Distance s of the compared neighbours from the pixel [px]. Larger steps average noise.
        smoothing: Half width of a box over which g is averaged [px]; 0 for no averaging. At most
            twice the step, which is the width of the strip without normals along a depth jump. The
            box then never reaches the other surface.
        relative_jump: A neighbour is on another surface if its depth differs from the pixel's by
            more than this fraction for each pixel of the step.

    Returns:
        (H, W, 3) float32 unit normals in the optical frame. A normal is NaN if the pixel's depth is
        invalid, or if one of its neighbours is invalid, on another surface or outside the image.
    """
    z = np.where(np.isfinite(depth) & (depth > 0.0), depth, 0.0).astype(np.float32)
    height, width = z.shape
    if height <= 2 * step or width <= 2 * step:
        return np.full((height, width, 3), np.nan, dtype=np.float32)
    inner = np.s_[step:-step, step:-step]
    left, right = z[step:-step, : -2 * step], z[step:-step, 2 * step :]
    above, below = z[: -2 * step, step:-step], z[2 * step :, step:-step]
    # On one surface, all five depths differ from the centre's by less than the jump. An invalid
    # depth is zero, which is a jump.
    jump = np.float32(min(relative_jump * step, 0.5))
    farthest = cv2.dilate(z, _plus(step))[inner]
    nearest = cv2.erode(z, _plus(step))[inner]
    valid = (farthest <= (1 + jump) * z[inner]) & (nearest > (1 - jump) * z[inner])
    gu, gv = right - left, below - above
    gu /= np.maximum(right + left, _TINY) * step
    gv /= np.maximum(below + above, _TINY) * step
    if smoothing > 0:
        size = (2 * smoothing + 1, 2 * smoothing + 1)
        trust = valid.astype(np.float32)
        share = np.maximum(_box(trust, size), _TINY)
        gu, gv = _box(gu * trust, size) / share, _box(gv * trust, size) / share
    u = (np.arange(step, width - step) - K[0, 2]).astype(np.float32)
    v = (np.arange(step, height - step) - K[1, 2]).astype(np.float32)[:, None]
    n_z = -1 - u * gu
    n_z -= v * gv
    gu *= np.float32(K[0, 0])
    gv *= np.float32(K[1, 1])
    scale = 1 / np.sqrt(gu * gu + gv * gv + n_z * n_z)
    scale[~valid] = np.nan
    normals = cv2.merge([gu * scale, gv * scale, n_z * scale])
    border = (step, step, step, step)
    return cv2.copyMakeBorder(normals, *border, cv2.BORDER_CONSTANT, value=(np.nan,) * 3)


def _disc(radius: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def _plus(step: int) -> np.ndarray:
    """Returns a kernel for `cv2.dilate`: the centre and its four neighbours `step` pixels away."""
    kernel = np.zeros((2 * step + 1, 2 * step + 1), dtype=np.uint8)
    kernel[step, [0, step, -1]] = kernel[[0, -1], step] = 1
    return kernel


def _box(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return cv2.blur(image, size, borderType=cv2.BORDER_REFLECT_101)
