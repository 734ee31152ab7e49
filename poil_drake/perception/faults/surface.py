"""Objects that are hard to see: without texture, glossy, or transparent."""

from dataclasses import dataclass

import cv2
import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.perception.faults.fault import CameraFault, Capture
from poil_drake.perception.faults.scene import random_patches
from poil_drake.perception.images import CameraModel, RgbdImage

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
        window, mask = _object_window(capture)
        rgb = capture.image.rgb.copy()
        plain = _blurred(rgb[window].astype(np.float32), mask, _SMOOTHING)
        rgb[window][mask] = np.rint(plain)[mask]
        return capture.changed(rgb=rgb)


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
        window, mask = _object_window(capture)
        rgb, depth = capture.image.rgb.copy(), capture.image.depth.copy()
        valid = mask & (depth[window] > 0.0)
        smooth = _blurred(depth[window][..., None], valid, _NORMAL_SMOOTHING)
        points = smooth * _rays(capture.camera)[window]
        normals = _unit(np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1)))
        lamp = _unit(capture.camera.X_WC[:3, :3].T @ np.array(self.lamp))
        half = _unit(_unit(-points) + lamp)
        # The normal that points to the camera, whatever the order of the gradients.
        highlight = mask * np.abs(np.sum(normals * half, axis=-1)) ** self.shininess
        rgb[window] = np.rint(rgb[window] + highlight[..., None] * (255.0 - rgb[window]))
        depth[window][highlight >= _HIGHLIGHT_DEPTH_LOSS] = 0.0
        return capture.changed(rgb=rgb, depth=depth)


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
        window, mask = _object_window(capture)
        depth = capture.image.depth.copy()
        lost = random_patches(mask.shape, self.share, self.radius, capture.rng)
        depth[window][mask & lost] = 0.0
        return capture.changed(depth=depth)


def _object_window(capture: Capture) -> tuple[tuple[slice, slice], np.ndarray]:
    """Returns the rows and columns around the object, and the object's mask (h, w) there.

    Where the object is not seen, they are one corner of the image.

    Raises:
        InvalidValueError: if it is unknown where the object is.
    """
    mask = capture.object_mask
    if mask is None:
        raise InvalidValueError(
            f"The images of camera '{capture.camera.name}' do not tell which pixels show the "
            "object, so its surface cannot be changed.",
            remedy="Use a simulator's images with labels, or leave out faults of the object.",
        )
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    # Two pixels at least, between which there is a gradient.
    y, x = min(y, mask.shape[0] - 2), min(x, mask.shape[1] - 2)
    window = slice(y, y + max(height, 2)), slice(x, x + max(width, 2))
    return window, mask[window]


def _blurred(values: np.ndarray, mask: np.ndarray, sigma: float) -> np.ndarray:
    """Returns values (H, W, C), each the Gaussian mean of the values in the mask around it."""
    weights = mask.astype(np.float32)
    total = cv2.GaussianBlur(values * weights[..., None], (0, 0), sigma).reshape(values.shape)
    return total / np.maximum(cv2.GaussianBlur(weights, (0, 0), sigma), 1e-3)[..., None]


def _rays(camera: CameraModel) -> np.ndarray:
    """Returns the points (H, W, 3) that the pixels show at a depth of 1, in the optical frame."""
    v, u = np.indices((camera.height, camera.width))
    K = camera.K
    return np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=-1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
