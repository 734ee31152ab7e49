"""Pixels as Drake's images."""

from typing import Any

import cv2
import numpy as np
from pydrake.systems.sensors import ImageRgba8U


def rgba_image(rgb: np.ndarray) -> ImageRgba8U:
    """Returns colours (H, W, 3) uint8 as an opaque image."""
    image = ImageRgba8U()
    fill_rgba(image, rgb)
    return image


def plane_image(kind: Any, pixels: np.ndarray) -> Any:
    """Returns pixels (H, W) as an image of one channel, of a kind such as `ImageDepth32F`."""
    image = kind()
    fill_plane(image, pixels)
    return image


def fill_rgba(image: ImageRgba8U, rgb: np.ndarray) -> None:
    """Makes an image show colours (H, W, 3) uint8, opaque, in its own memory if they fit."""
    _resize(image, rgb.shape)
    cv2.cvtColor(rgb, cv2.COLOR_RGB2RGBA, dst=image.mutable_data)


def fill_plane(image: Any, pixels: np.ndarray) -> None:
    """Makes an image of one channel show pixels (H, W), in its own memory if they fit."""
    _resize(image, pixels.shape)
    image.mutable_data[:, :, 0] = pixels


def _resize(image: Any, shape: tuple[int, ...]) -> None:
    height, width = shape[:2]
    if (image.width(), image.height()) != (width, height):
        image.resize(width, height)
