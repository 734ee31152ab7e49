"""What a stereo camera makes of depth: noise, flying pixels and holes, on a renderer's images."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class StereoDepthNoiseConfig:
    """A stereo camera's errors.

    Stereo measures disparity, which goes with inverse depth, so noise of constant size there grows
    with the square of the depth.

    Attributes:
        enabled: False leaves the depth as it is, but for invalid pixels, which become 0.
        quadratic: k [1/m] of the standard deviation k z^2 of the depth. 0.0015 is 1.5 mm at 1 m and
            0.6 mm at 0.65 m, like a ZED.
        correlation_length: Pitch of the grid of independent errors [px], between which the noise
            is interpolated; matching compares windows, so neighbours err together.
        inverse_depth_step: Quantum of the inverse depth [1/m]; 0 for none. A focal length of
            460 px, a baseline of 0.12 m and steps of 1/32 px make 0.0006.
        edge_jump: Neighbours whose depth differs by more than this part of the nearer depth are at
            an edge.
        flying_width: Distance from an edge up to which pixels may fly, that is, get a depth between
            the two surfaces [px].
        flying_probability: Part of those pixels that do.
        hole_width: Distance from an edge, on the farther surface, up to which pixels may be lost,
            because the second camera does not see them [px].
        hole_probability: Part of those pixels that are.
        blob_count: Mean number of round holes in an image, from reflections and plain surfaces.
        blob_radius: Smallest and largest radius of these [px].
        min_depth: What is nearer is lost [m].
        max_depth: What is farther is lost [m].
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
        if not 0.0 < self.min_depth < self.max_depth:
            raise InvalidValueError(
                f"StereoDepthNoiseConfig trusts depths from {self.min_depth} to {self.max_depth} "
                "m.",
                remedy="Pass 0 < min_depth < max_depth.",
            )
        for name in ("quadratic", "inverse_depth_step", "edge_jump", "blob_count"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise InvalidValueError(
                    f"StereoDepthNoiseConfig.{name} is {getattr(self, name)}.",
                    remedy="It must be finite and not negative.",
                )
        if not 0 <= self.blob_radius[0] <= self.blob_radius[1]:
            raise InvalidValueError(
                f"StereoDepthNoiseConfig.blob_radius is {self.blob_radius} px.",
                remedy="Pass the smallest radius, then the largest.",
            )
        for name in ("flying_probability", "hole_probability"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InvalidValueError(
                    f"StereoDepthNoiseConfig.{name} is {getattr(self, name)}.",
                    remedy="A probability lies in [0, 1].",
                )
        if self.correlation_length < 1 or min(self.flying_width, self.hole_width) < 0:
            raise InvalidValueError(
                f"StereoDepthNoiseConfig has correlation_length={self.correlation_length}, "
                f"flying_width={self.flying_width} and hole_width={self.hole_width} px.",
                remedy="The first must be at least 1, the others at least 0.",
            )


def apply_stereo_depth_noise(
    depth: np.ndarray, config: StereoDepthNoiseConfig, seed: Sequence[int] | int
) -> np.ndarray:
    """Returns depth as a stereo camera would measure it.

    Args:
        depth: (H, W) true depth along the optical axis [m]; 0, NaN and infinity are invalid.
        config: The camera's errors.
        seed: Numbers that are not negative, such as (seed, camera, frame). Equal seeds give equal
            errors.

    Returns:
        (H, W) float32 [m], 0 where invalid.
    """
    depth = np.asarray(depth, dtype=np.float32)
    if not config.enabled:
        return np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0))
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Zero is infinitely far, which is what an invalid pixel counts as.
        w = np.reciprocal(depth)
        valid = (w >= np.float32(1.0 / config.max_depth)) & (
            w <= np.float32(1.0 / config.min_depth)
        )
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
    """Makes pixels fly in the inverse depth `w` (H, W), and loses pixels from `valid` (H, W)."""
    chance = np.frombuffer(rng.bytes(w.size), dtype=np.uint8).reshape(w.shape)
    ratio = np.float32(1.0 + config.edge_jump)
    if config.hole_width > 0:
        lost = cv2.dilate(w, _square(config.hole_width)) > ratio * w
        lost &= chance < round(256 * config.hole_probability)
        valid &= ~lost
    if config.flying_width > 0:
        near = cv2.dilate(w, _square(config.flying_width))
        far = cv2.erode(w, _square(config.flying_width))
        # Surfaces against nothing have nothing to fly towards.
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
    """Returns noise (H, W) of the inverse depth: a coarse grid of nodes, interpolated."""
    height, width = shape
    pitch = config.correlation_length
    # Two nodes more than fit, so that every pixel lies between nodes.
    rows, columns = -(-height // pitch) + 2, -(-width // pitch) + 2
    nodes = rng.standard_normal((rows, columns), dtype=np.float32)
    noise = cv2.resize(nodes, (columns * pitch, rows * pitch), interpolation=cv2.INTER_LINEAR)
    inner = noise[pitch : pitch + height, pitch : pitch + width]
    return inner * _interpolation_gain(height, width, pitch, config.quadratic)


@lru_cache(maxsize=8)
def _interpolation_gain(height: int, width: int, pitch: int, scale: float) -> np.ndarray:
    """Returns (H, W) by what to multiply interpolated unit noise for a deviation of `scale`.

    At a fraction f between two independent nodes linear interpolation leaves the variance
    (1 - f)^2 + f^2, along each axis.
    """

    def gain(size: int) -> np.ndarray:
        # cv2.resize() puts the centre of the target's pixel i at (i + 0.5) / pitch - 0.5.
        f = ((np.arange(size) + 0.5) / pitch + 0.5) % 1.0
        return 1.0 / np.sqrt((1.0 - f) ** 2 + f**2)

    gains = (scale * gain(height)[:, None] * gain(width)).astype(np.float32)
    gains.flags.writeable = False
    return gains


def _square(radius: int) -> np.ndarray:
    return np.ones((2 * radius + 1, 2 * radius + 1), dtype=np.uint8)
