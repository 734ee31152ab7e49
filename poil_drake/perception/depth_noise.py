"""Adds the depth errors of a stereo camera to rendered images: noise, flying pixels and holes."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError

_NEIGHBOURS = np.ones((3, 3), np.uint8)

# Bounds (lowest, highest) on fields of `StereoDepthNoiseConfig`.
_LIMITS = {
    "quadratic": (0.0, np.inf),
    "correlation_length": (1, np.inf),
    "inverse_depth_step": (0.0, np.inf),
    "edge_jump": (0.0, np.inf),
    "flying_width": (0, np.inf),
    "flying_probability": (0.0, 1.0),
    "hole_width": (0, np.inf),
    "hole_probability": (0.0, 1.0),
    "blob_count": (0.0, np.inf),
}


@dataclass(frozen=True, kw_only=True)
class StereoDepthNoiseConfig:
    """The errors of a stereo camera.

    Stereo measures disparity, which is proportional to inverse depth. If the noise of the disparity
    is constant, the noise of the depth grows with the square of the depth.

    Attributes:
        enabled: If False, no errors are added; invalid pixels are still set to 0.
        quadratic: Factor k [1/m] in the standard deviation k z^2 of the depth z. 0.0015 is 1.5 mm
            at 1 m and 0.6 mm at 0.65 m, as for a ZED.
        correlation_length: Pitch of a grid of independent errors [px]. The noise is interpolated
            between the nodes of the grid, because stereo matches windows and neighbouring pixels
            therefore have correlated errors.
        inverse_depth_step: Quantization step of the inverse depth [1/m]; 0 for none. A focal length
            of 460 px, a baseline of 0.12 m and disparity steps of 1/32 px give 0.0006.
        edge_jump: Neighbouring pixels are at an edge if their depths differ by more than this
            fraction of the smaller depth.
        flying_width: Distance from an edge [px] within which pixels may fly, that is, get a depth
            between the two surfaces.
        flying_probability: Probability that a pixel within `flying_width` of an edge flies.
        hole_width: Distance from an edge [px] within which pixels of the farther surface may be
            lost, because the second camera does not see them.
        hole_probability: Probability that a pixel of the farther surface within `hole_width` of an
            edge is lost.
        blob_count: Mean number of elliptical holes per image. In real images, reflections and
            surfaces without texture cause such holes.
        blob_radius: Smallest and largest semi-axis of the elliptical holes [px].
        min_depth: Depth below which pixels are lost [m].
        max_depth: Depth above which pixels are lost [m].
    """

    enabled: bool = True
    quadratic: float = 0.0015
    correlation_length: int = 3
    inverse_depth_step: float = 0.0006
    edge_jump: float = 0.03
    flying_width: int = 1
    flying_probability: float = 0.25
    hole_width: int = 3
    hole_probability: float = 0.5
    blob_count: float = 3.0
    blob_radius: tuple[int, int] = (2, 6)
    min_depth: float = 0.2
    max_depth: float = 5.0

    def __post_init__(self) -> None:
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            if not (low <= value <= high and np.isfinite(value)):
                raise InvalidValueError(
                    f"StereoDepthNoiseConfig.{name} is {value}.",
                    remedy=f"Set a finite number of at least {low}"
                    f"{f' and at most {high}' if high < np.inf else ''}.",
                )
        if not 0.0 < self.min_depth < self.max_depth:
            raise InvalidValueError(
                f"StereoDepthNoiseConfig has min_depth={self.min_depth} and "
                f"max_depth={self.max_depth} m.",
                remedy="Set 0 < min_depth < max_depth.",
            )
        if not 0 <= self.blob_radius[0] <= self.blob_radius[1]:
            raise InvalidValueError(
                f"StereoDepthNoiseConfig.blob_radius is {self.blob_radius} px.",
                remedy="Set (smallest, largest) with 0 <= smallest <= largest.",
            )


def apply_stereo_depth_noise(
    depth: np.ndarray, config: StereoDepthNoiseConfig, seed: Sequence[int] | int
) -> np.ndarray:
    """Returns the depth image that a stereo camera would measure.

    Args:
        depth: (H, W) true depth along the optical axis [m]; 0, NaN and infinity are invalid.
        config: The camera's errors.
        seed: Non-negative numbers, such as (seed, camera, frame). Equal seeds give equal errors.

    Returns:
        (H, W) float32 [m], 0 where invalid.
    """
    depth = np.asarray(depth, dtype=np.float32)
    if not config.enabled:
        return np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0))
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    with np.errstate(divide="ignore", invalid="ignore"):
        w = np.reciprocal(depth)
        valid = (w >= np.float32(1.0 / config.max_depth)) & (
            w <= np.float32(1.0 / config.min_depth)
        )
    # Invalid pixels count as infinitely far.
    np.copyto(w, np.float32(0.0), where=~valid)
    _disturb_edges(w, valid, config, rng)
    _punch_holes(valid, config, rng)
    w += _correlated_noise(w.shape, config, rng)
    if config.inverse_depth_step > 0.0:
        w *= np.float32(1.0 / config.inverse_depth_step)
        np.rint(w, out=w)
        w *= np.float32(config.inverse_depth_step)
    valid &= w > 0.0
    np.copyto(w, np.float32(np.inf), where=~valid)
    return np.reciprocal(w, out=w)


def _disturb_edges(
    w: np.ndarray, valid: np.ndarray, config: StereoDepthNoiseConfig, rng: np.random.Generator
) -> None:
    """Adds flying pixels to the inverse depth `w` (H, W) [1/m] and holes to `valid` (H, W) bool."""
    chance = np.frombuffer(rng.bytes(w.size), dtype=np.uint8).reshape(w.shape)
    ratio = np.float32(1.0 + config.edge_jump)
    lost = cv2.dilate(w, _NEIGHBOURS, iterations=config.hole_width) > ratio * w
    lost &= chance < round(256 * config.hole_probability)
    valid &= ~lost
    near = cv2.dilate(w, _NEIGHBOURS, iterations=config.flying_width)
    far = cv2.erode(w, _NEIGHBOURS, iterations=config.flying_width)
    # Pixels fly only between two valid surfaces.
    flying = (near > ratio * far) & (far > 0.0)
    flying &= chance >= 256 - round(256 * config.flying_probability)
    place = np.flatnonzero(flying)
    z_near, z_far = 1.0 / near.ravel()[place], 1.0 / far.ravel()[place]
    share = rng.random(place.size, dtype=np.float32)
    w.ravel()[place] = 1.0 / (z_near + share * (z_far - z_near))


def _punch_holes(
    valid: np.ndarray, config: StereoDepthNoiseConfig, rng: np.random.Generator
) -> None:
    height, width = valid.shape
    mask = valid.view(np.uint8)
    smallest, largest = config.blob_radius
    for _ in range(rng.poisson(config.blob_count)):
        centre = (int(rng.integers(width)), int(rng.integers(height)))
        axes = tuple(int(r) for r in rng.integers(smallest, largest, 2, endpoint=True))
        cv2.ellipse(mask, centre, axes, float(rng.uniform(0.0, 180.0)), 0.0, 360.0, 0, -1)


def _correlated_noise(
    shape: tuple[int, ...], config: StereoDepthNoiseConfig, rng: np.random.Generator
) -> np.ndarray:
    """Returns noise (H, W) of the inverse depth [1/m], interpolated between nodes of a grid."""
    height, width = shape
    pitch = config.correlation_length
    # The grid has two more nodes than the image, so that every pixel lies between nodes.
    rows, columns = -(-height // pitch) + 2, -(-width // pitch) + 2
    nodes = rng.standard_normal((rows, columns), dtype=np.float32)
    noise = cv2.resize(nodes, (columns * pitch, rows * pitch), interpolation=cv2.INTER_LINEAR)
    inner = noise[pitch : pitch + height, pitch : pitch + width]
    return inner * _interpolation_gain(height, width, pitch, config.quadratic)


@lru_cache(maxsize=8)
def _interpolation_gain(height: int, width: int, pitch: int, scale: float) -> np.ndarray:
    """Returns the factors (H, W) that give interpolated unit noise the standard deviation `scale`.

    At a fraction f between two independent nodes, linear interpolation has the variance
    (1 - f)^2 + f^2, along each axis.
    """

    def gain(size: int) -> np.ndarray:
        # cv2.resize() places the centre of target pixel i at (i + 0.5) / pitch - 0.5.
        f = ((np.arange(size) + 0.5) / pitch + 0.5) % 1.0
        return 1.0 / np.sqrt((1.0 - f) ** 2 + f**2)

    gains = (scale * gain(height)[:, None] * gain(width)).astype(np.float32)
    gains.flags.writeable = False
    return gains
