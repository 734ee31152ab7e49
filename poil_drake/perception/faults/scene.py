"""Faults of what a camera sees: something in the way, bad depth, other light."""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.perception.faults.fault import CameraFault, Capture
from poil_drake.perception.images import RgbdImage

_EMPTY_LABEL = 32767  # Drake's RenderLabel.kEmpty: no object of the scene.

_SHAPES = ("board", "hand")
_COLORS = {"board": (120, 96, 70), "hand": (205, 150, 125)}  # plywood and skin, RGB

# Palm, four fingers and thumb as ellipses: centre and semi-axes in a box [-1, 1]^2, angle [deg].
_HAND = (
    ((0.0, 0.35), (0.55, 0.62), 0.0),
    ((-0.42, -0.45), (0.13, 0.45), -8.0),
    ((-0.14, -0.52), (0.13, 0.48), -2.0),
    ((0.14, -0.50), (0.13, 0.48), 2.0),
    ((0.40, -0.40), (0.12, 0.42), 8.0),
    ((0.70, 0.10), (0.14, 0.42), 40.0),
)


@dataclass(frozen=True, kw_only=True)
class Occluder(CameraFault):
    """A board or a hand, parallel to the image, that hides what is behind it.

    Attributes:
        shape: "board" or "hand".
        center: Position of its centre as a share of the image's width and height.
        size: Its width and height as a share of the image's.
        distance: Its depth [m]; nearer things stay visible.
    """

    shape: str = "board"
    center: tuple[float, float] = (0.5, 0.5)
    size: tuple[float, float] = (1.0, 1.0)
    distance: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("shape", self.shape in _SHAPES, f"one of: {', '.join(_SHAPES)}")
        self._require("distance", self.distance > 0.0, "a positive length")

    def apply(self, capture: Capture) -> RgbdImage:
        """Returns the image with the occluder in colour and depth."""
        image = capture.image
        hidden = self._silhouette(*image.depth.shape)
        hidden &= ~((image.depth > 0.0) & (image.depth < self.distance))
        label = image.label
        return capture.changed(
            rgb=np.where(hidden[..., None], np.array(_COLORS[self.shape], np.uint8), image.rgb),
            depth=np.where(hidden, np.float32(self.distance), image.depth),
            label=None if label is None else np.where(hidden, np.int16(_EMPTY_LABEL), label),
        )

    def _silhouette(self, height: int, width: int) -> np.ndarray:
        """Returns the pixels (H, W) bool within the occluder's outline."""
        full = np.array([width, height])
        middle, half = full * self.center, full * self.size / 2
        mask = np.zeros((height, width), np.uint8)
        if self.shape == "board":
            (u0, v0), (u1, v1) = (
                np.rint([middle - half, middle + half]).astype(int).clip(0).tolist()
            )
            mask[v0:v1, u0:u1] = 1
        else:
            for at, axes, angle in _HAND:
                box = ((middle + half * at).tolist(), (2 * half * axes).tolist(), angle)
                cv2.ellipse(mask, box, 1, -1)
        return mask.astype(bool)


@dataclass(frozen=True, kw_only=True)
class DepthHoles(CameraFault):
    """Patches of the depth image are lost, other ones in each image.

    Attributes:
        share: Share of the pixels that are lost.
        radius: Size of the patches [px].
    """

    share: float = 0.3
    radius: int = 12

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("share", 0.0 <= self.share <= 1.0, "a number in [0, 1]")
        self._require("radius", self.radius >= 1, "at least 1 pixel")

    def apply(self, capture: Capture) -> RgbdImage:
        """Returns the image with holes in its depth."""
        lost = random_patches(capture.image.depth.shape, self.share, self.radius, capture.rng)
        return capture.changed(depth=np.where(lost, np.float32(0.0), capture.image.depth))


@dataclass(frozen=True, kw_only=True)
class DepthError(CameraFault):
    """A wrong depth: `scale` z + `bias`.

    Attributes:
        scale: Factor on the depth.
        bias: What is added to it [m].
    """

    scale: float = 1.0
    bias: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("scale", self.scale > 0.0, "a positive number")

    def apply(self, capture: Capture) -> RgbdImage:
        """Returns the image with the wrong depth; what becomes negative is invalid."""
        z = capture.image.depth
        wrong = np.float32(self.scale) * z + np.float32(self.bias)
        return capture.changed(depth=np.where((z > 0.0) & (wrong > 0.0), wrong, np.float32(0.0)))


@dataclass(frozen=True, kw_only=True)
class LightChange(CameraFault):
    """Other light, to which the camera's exposure does not adapt.

    Attributes:
        gain: Factors on red, green and blue.
    """

    gain: tuple[float, float, float] = (0.4, 0.4, 0.4)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("gain", min(self.gain) >= 0.0, "three numbers of at least 0")

    def apply(self, capture: Capture) -> RgbdImage:
        """Returns the image in the other light."""
        lit = np.clip(capture.image.rgb * np.array(self.gain, np.float32), 0.0, 255.0)
        return capture.changed(rgb=lit.astype(np.uint8))


def random_patches(
    shape: tuple[int, ...], share: float, radius: int, rng: np.random.Generator
) -> np.ndarray:
    """Returns a mask (H, W) bool of smooth patches that cover a share of the image.

    Args:
        shape: (H, W).
        share: Share of the pixels in the mask, in [0, 1].
        radius: Distance of the nodes between which the patches' random height varies [px].
        rng: Source of the random numbers.
    """
    height, width = shape
    nodes = rng.random((height // radius + 2, width // radius + 2), dtype=np.float32)
    heights = cv2.resize(nodes, (width, height), interpolation=cv2.INTER_LINEAR)
    return heights < np.quantile(heights, share) if share < 1.0 else np.ones(shape, bool)
