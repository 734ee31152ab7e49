"""Flat obstacles made of points."""

import numpy as np


def point_grid(x: np.ndarray | float, y: np.ndarray | float, z: np.ndarray | float) -> np.ndarray:
    """Returns the points (P, 3) of all combinations of coordinates."""
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)
