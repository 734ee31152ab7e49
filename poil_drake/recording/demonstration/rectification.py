"""Removes lens distortion, so that the pinhole model holds."""

from functools import lru_cache

import cv2
import numpy as np

from poil_drake.recording.mcap.message_decoders import Calibration


def rectify(image: np.ndarray, calibration: Calibration, *, interpolate: bool) -> np.ndarray:
    """Returns the image that a pinhole camera with the same K would take.

    Args:
        image: (H, W) or (H, W, 3).
        calibration: The camera's calibration. Without distortion, the image is returned unchanged.
        interpolate: Use True for colour. False takes the nearest pixel, so that depth and labels
            are not mixed across edges.

    Returns:
        An image of the same shape; 0 outside the field of view of the lens.
    """
    if calibration.distortion.size == 0:
        return image
    map_u, map_v = _maps(
        tuple(calibration.K.ravel()),
        tuple(calibration.distortion),
        (calibration.width, calibration.height),
    )
    return cv2.remap(
        image,
        map_u,
        map_v,
        cv2.INTER_LINEAR if interpolate else cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=0,
    )


@lru_cache(maxsize=8)
def _maps(
    K: tuple[float, ...], distortion: tuple[float, ...], size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Returns (H, W) u and v: where each rectified pixel is in the distorted image [px]."""
    matrix = np.reshape(K, (3, 3))
    return cv2.initUndistortRectifyMap(
        matrix, np.array(distortion), None, matrix, size, cv2.CV_32FC1
    )
