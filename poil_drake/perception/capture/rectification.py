"""Converts the images of a RealSense to those of a pinhole camera."""

from itertools import product
from typing import Any

import cv2
import numpy as np

from poil_drake.errors import CaptureError

_KNOWN = ("brown_conrady", "modified_brown_conrady", "inverse_brown_conrady")

_GRID = 9
"""Number of points along each image side that OpenCV and the library project for comparison."""

_TOLERANCE = 0.5
"""Largest accepted difference between OpenCV's and the library's projections [px]. With
pyrealsense2 2.59 and the coefficients of a D455, they differ by 0.02 px."""


class Rectification:
    """Undistorts colour images and the depth images that are aligned to them.

    The library aligns depth to the distorted colour image. It labels most colour images
    `inverse_brown_conrady`, but projects by the Brown-Conrady polynomial, as OpenCV does. Because
    the label is wrong, and because older versions of the library ignore distortion, the constructor
    compares projections by the library with projections by OpenCV.

    Attributes:
        K: (3, 3) intrinsic matrix of the undistorted images [px].
    """

    def __init__(self, rs: Any, intrinsics: Any, *, source: str):
        """Computes the undistortion maps, which serve all images.

        Args:
            rs: The module `pyrealsense2`.
            intrinsics: The `rs.intrinsics` of the colour stream.
            source: The camera's name in errors.

        Raises:
            CaptureError: if OpenCV's model does not reproduce the library's distortion.
        """
        fx, fy, cx, cy = intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy
        self.K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        self._maps: tuple[np.ndarray, np.ndarray] | None = None
        coefficients = np.array(intrinsics.coeffs, float)
        if intrinsics.model.name == "none" or not coefficients.any():
            return
        size = (intrinsics.width, intrinsics.height)
        u, v = cv2.initUndistortRectifyMap(
            self.K, coefficients, np.eye(3), self.K, size, cv2.CV_32FC1
        )
        if intrinsics.model.name not in _KNOWN or not self._agrees(rs, intrinsics, u, v):
            raise CaptureError(
                f"{source} has images distorted by the model '{intrinsics.model.name}' with the "
                f"coefficients {coefficients.tolist()}, which is not supported.",
                remedy="Update pyrealsense2 and the camera's firmware, or send rectified images "
                "over LCM (!LcmImages).",
            )
        self._maps = cv2.convertMaps(u, v, cv2.CV_16SC2)

    def color(self, pixels: np.ndarray) -> np.ndarray:
        """Undistorts colour (H, W, 3) uint8 by interpolation. Pixels without a source are 0."""
        if self._maps is None:
            return pixels
        return cv2.remap(pixels, *self._maps, cv2.INTER_LINEAR)

    def depth(self, pixels: np.ndarray) -> np.ndarray:
        """Undistorts depth (H, W) by nearest neighbour. Pixels without a source are 0."""
        if self._maps is None:
            return pixels
        return cv2.remap(pixels, *self._maps, cv2.INTER_NEAREST)

    def _agrees(self, rs: Any, intrinsics: Any, u: np.ndarray, v: np.ndarray) -> bool:
        """Returns whether the library's projection fits OpenCV's maps u and v (H, W) [px]."""
        rows, columns = (np.linspace(0, size - 1, _GRID).astype(int) for size in u.shape)
        for row, column in product(rows, columns):
            ray = np.linalg.solve(self.K, [column, row, 1.0])
            found = rs.rs2_project_point_to_pixel(intrinsics, ray.tolist())
            expected = (u[row, column], v[row, column])
            if not np.allclose(found, expected, rtol=0.0, atol=_TOLERANCE):
                return False
        return True
