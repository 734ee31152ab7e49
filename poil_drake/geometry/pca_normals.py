"""Surface normals of a cloud by principal component analysis of neighbourhoods."""

import numpy as np
from scipy.spatial import cKDTree

_NEIGHBOURS = 16
"""Number of points in a neighbourhood, including the point itself."""


def pca_normals(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Returns unit normals (M, 3) of a surface, which face the camera at the frame's origin.

    A normal is the direction in which the nearest neighbours of a point spread least.

    Args:
        points: (P, 3) points on the surface [m, camera], at least 3.
        at: (M,) indices of the points to compute normals at.
    """
    queries = points[at]
    _, nearest = cKDTree(points).query(queries, k=min(_NEIGHBOURS, len(points)))
    arms = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.swapaxes(arms, -1, -2) @ arms)
    normals = axes[..., 0]
    away = np.einsum("mi,mi->m", normals, queries) > 0.0
    return np.where(away[:, None], -normals, normals)
