"""Restricts masks to pixels with reliable depth."""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class DepthMaskConfig:
    """Which pixels to remove from masks: borders, depth edges and unreliable depths.

    Attributes:
        erosion: Width of the border removed from the mask [px]. Detectors' masks are about a pixel
            too large. A larger erosion may erase thin parts: at 0.65 m, a mug's handle is only
            about 7 px wide.
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


def clean_mask(mask: np.ndarray, depth: np.ndarray, config: DepthMaskConfig) -> np.ndarray:
    """Returns a mask (H, W) bool without its border, unreliable depths and depth edges.

    Args:
        mask: (H, W) bool, the mask to clean.
        depth: (H, W) depth [m]; 0, NaN and infinity are invalid.
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
    edges = cv2.dilate(edges, _disc(config.edge_margin)).astype(bool)
    reliable = (depth >= config.min_depth) & (depth <= config.max_depth)
    return erode_mask(mask, config.erosion) & reliable & ~edges


def _disc(radius: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
