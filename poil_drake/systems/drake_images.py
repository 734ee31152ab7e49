"""Pixels as Drake's images."""

from typing import Any

import cv2
import numpy as np
from pydrake.systems.sensors import ImageRgba8U


def rgba_image(rgb: np.ndarray) -> ImageRgba8U:
    """Returns colours (H, W, 3) uint8 as an opaque image."""
    image = ImageRgba8U(rgb.shape[1], rgb.shape[0])
    cv2.cvtColor(rgb, cv2.COLOR_RGB2RGBA, dst=image.mutable_data)
    return image


def plane_image(kind: Any, pixels: np.ndarray) -> Any:
    """Returns pixels (H, W) as an image of one channel, of a kind such as `ImageDepth32F`."""
    image = kind(pixels.shape[1], pixels.shape[0])
    image.mutable_data[:, :, 0] = pixels
    return image
