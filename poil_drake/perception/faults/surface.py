"""Objects that are hard to see: without texture, glossy, or transparent."""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.perception.faults.fault import CameraFault, Capture
from poil_drake.perception.faults.scene import random_patches
from poil_drake.perception.images import RgbdImage

_SMOOTHING = 10.0  # [px] wider than a texture, narrower than the shading of a cup
_NORMAL_SMOOTHING = 3.0  # [px] wider than the depth noise
_HIGHLIGHT_DEPTH_LOSS = 0.5  # Depth is lost where a highlight is at least this bright.


@dataclass(frozen=True, kw_only=True)
class ObjectFault(CameraFault):
    """A fault of the object's surface; the images must tell which pixels show the object."""


@dataclass(frozen=True, kw_only=True)
class UntexturedObject(ObjectFault):
    """The object's surface has one colour; its shading stays."""

    def apply(self, capture: Capture) -> RgbdImage:
        """Returns the image with the object's colours blurred within its outline."""
        mask = _object_mask(capture)
        plain = _blurred(capture.image.rgb.astype(np.float32), mask, _SMOOTHING)
        rgb = np.where(mask[..., None], np.rint(plain), capture.image.rgb)
        return capture.changed(rgb=rgb.astype(np.uint8))


@dataclass(frozen=True, kw_only=True)
class GlossyObject(ObjectFault):
    """The object reflects a lamp: a white highlight (Blinn-Phong), under which depth is lost.

    Attributes:
        lamp: Direction to the lamp in the world. The default is a window, whose light upright walls
            reflect; a lamp on the ceiling shows on what faces upwards.
        shininess: Exponent of the highlight; the larger, the smaller the highlight.
    """

    lamp: tuple[float, float, float] = (0.8, 0.0, 0.2)
    shininess: float = 10.0

    def apply(self, capture: Capture) -> RgbdImage:
        """Returns the image with a highlight on the object."""
        image, mask = capture.image, _object_mask(capture)
        valid = mask & (image.depth > 0.0)
        depth = _blurred(image.depth[..., None], valid, _NORMAL_SMOOTHING)[..., 0]
        points = _unprojected(depth, capture.camera.K)
        normals = _unit(np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1)))
        to_camera = _unit(-points)
        half = _unit(to_camera + _unit(capture.camera.X_WC[:3, :3].T @ np.array(self.lamp)))
        # The normal that points to the camera, whatever the order of the gradients.
        cosine = np.abs(np.sum(normals * half, axis=-1)) * mask
        highlight = cosine**self.shininess
        rgb = image.rgb + highlight[..., None] * (255.0 - image.rgb)
        lost = highlight >= _HIGHLIGHT_DEPTH_LOSS
        return capture.changed(
            rgb=np.rint(rgb).astype(np.uint8), depth=np.where(lost, np.float32(0.0), image.depth)
        )


@dataclass(frozen=True, kw_only=True)
class TransparentObject(ObjectFault):
    """Depth is lost in patches of the object, as with glass.

    Attributes:
        share: Share of the object's pixels that are lost.
        radius: Size of the patches [px].
    """

    share: float = 0.6
    radius: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("share", 0.0 <= self.share <= 1.0, "a number in [0, 1]")
        self._require("radius", self.radius >= 1, "at least 1 pixel")

    def apply(self, capture: Capture) -> RgbdImage:
        """Returns the image with holes in the object's depth."""
        depth = capture.image.depth
        lost = random_patches(depth.shape, self.share, self.radius, capture.rng)
        lost &= _object_mask(capture)
        return capture.changed(depth=np.where(lost, np.float32(0.0), depth))


def _object_mask(capture: Capture) -> np.ndarray:
    if capture.object_mask is None:
        raise InvalidValueError(
            f"The images of camera '{capture.camera.name}' do not tell which pixels show the "
            "object, so its surface cannot be changed.",
            remedy="Use a simulator's images with labels, or leave out faults of the object.",
        )
    return capture.object_mask


def _blurred(values: np.ndarray, mask: np.ndarray, sigma: float) -> np.ndarray:
    """Returns values (H, W, C), each the Gaussian mean of the values in the mask around it."""
    weights = mask.astype(np.float32)
    total = cv2.GaussianBlur(values * weights[..., None], (0, 0), sigma).reshape(values.shape)
    return total / np.maximum(cv2.GaussianBlur(weights, (0, 0), sigma), 1e-3)[..., None]


def _unprojected(depth: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Returns the points (H, W, 3) of a depth image (H, W) in the optical frame [m]."""
    v, u = np.indices(depth.shape)
    rays = [(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(depth.shape)]
    return np.stack(rays, axis=-1) * depth[..., None]


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
