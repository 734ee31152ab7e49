"""Removes lens distortion, so that the pinhole model holds."""

from functools import lru_cache

import cv2
import numpy as np

from poil_drake.recording.mcap.camera_messages import Calibration


def rectify(image: np.ndarray, calibration: Calibration, *, interpolate: bool) -> np.ndarray:
    """Returns an image as a pinhole camera with the same K would have taken it.

    Args:
        image: (H, W) or (H, W, 3).
        calibration: The lens. Without distortion the image is returned as it is.
        interpolate: True for colour. Depth and labels must not be mixed across edges, so the
            nearest pixel is taken for them.

    Returns:
        An image of the same shape; 0 where the lens did not look.
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
    """Returns for each pixel of the rectified image where the lens put it."""
    matrix = np.reshape(K, (3, 3))
    return cv2.initUndistortRectifyMap(
        matrix, np.array(distortion), None, matrix, size, cv2.CV_32FC1
    )
