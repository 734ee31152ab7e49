"""Keeping the pixels of a mask whose depth can be trusted."""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class DepthMaskConfig:
    """How much of a mask's border and of depth edges to give up.

    Attributes:
        erosion: Width of the border taken off the mask [px]. Detectors' masks spill over by about
            a pixel; a mug's handle is only some 7 px wide at 0.65 m.
        relative_jump: Two neighbouring pixels are on different surfaces where their depth differs
            by more than this part of the nearer depth. 0.03 is 2 cm at 0.65 m.
        edge_margin: Pixels this near to a depth edge are dropped too [px]; stereo depth
            interpolates between the surfaces there.
        min_depth: Nearest depth to trust [m].
        max_depth: Farthest depth to trust [m].
    """

    erosion: int = 1
    relative_jump: float = 0.03
    edge_margin: int = 1
    min_depth: float = 0.1
    max_depth: float = 3.0


def erode_mask(mask: np.ndarray, pixels: int) -> np.ndarray:
    """Takes a border of some pixels off a mask (H, W); the image's own border takes nothing off."""
    if pixels < 0:
        raise InvalidValueError(
            f"A mask cannot be eroded by {pixels} pixels.", remedy="Pass 0 or more."
        )
    if pixels == 0:
        return mask.astype(bool)
    return cv2.erode(mask.astype(np.uint8), _disc(pixels)).astype(bool)


def depth_edges(depth: np.ndarray, relative_jump: float) -> np.ndarray:
    """Returns which pixels lie beside a jump in depth, on either side of it.

    Args:
        depth: (H, W) depth [m]; 0, NaN and infinity are invalid and make no edge.
        relative_jump: The smallest jump that counts, as a part of the nearer depth.

    Returns:
        (H, W) bool.
    """
    z = np.where(np.isfinite(depth) & (depth > 0.0), depth, 0.0).astype(np.float32)
    edges = np.zeros(z.shape, dtype=bool)
    for first, second in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1, :], np.s_[1:, :]),
    ):
        a, b = z[first], z[second]
        nearer = np.minimum(a, b)
        jump = (np.abs(a - b) > np.float32(relative_jump) * nearer) & (nearer > 0.0)
        edges[first] |= jump
        edges[second] |= jump
    return edges


def clean_mask(mask: np.ndarray, depth: np.ndarray, config: DepthMaskConfig) -> np.ndarray:
    """Returns the pixels (H, W) bool of a mask whose depth is valid and away from edges.

    Args:
        mask: (H, W) bool.
        depth: (H, W) depth [m]; 0, NaN and infinity are invalid.
        config: How much to give up.
    """
    if mask.shape != depth.shape:
        raise InvalidValueError(
            f"clean_mask() got a mask of shape {mask.shape} for depth of shape {depth.shape}.",
            remedy="Pass a mask of the image's size.",
        )
    edges = depth_edges(depth, config.relative_jump)
    if config.edge_margin > 0:
        edges = cv2.dilate(edges.astype(np.uint8), _disc(config.edge_margin)).astype(bool)
    with np.errstate(invalid="ignore"):
        trusted = (depth >= config.min_depth) & (depth <= config.max_depth)
    return erode_mask(mask, config.erosion) & trusted & ~edges


def _disc(radius: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
