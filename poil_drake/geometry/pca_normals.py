"""Surface normals of a cloud from the spread of each point's neighbours."""

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.errors import InvalidValueError


def pca_normals(
    points: np.ndarray,
    *,
    viewpoint: np.ndarray,
    neighbours: int = 16,
    at: np.ndarray | None = None,
) -> np.ndarray:
    """Returns unit normals, each the direction in which a point's neighbours spread least.

    Args:
        points: (P, 3) [m], at least 3.
        viewpoint: (3,) where the points were seen from; normals point to that side.
        neighbours: How many nearest points make a neighbourhood, the point itself included.
        at: (M,) indices of the points whose normals are wanted, None for all.

    Returns:
        (M, 3), or (P, 3) where `at` is None.

    Raises:
        InvalidValueError: if there are fewer than 3 points.
    """
    if len(points) < 3:
        raise InvalidValueError(
            f"pca_normals() got {len(points)} points.", remedy="A surface needs at least 3."
        )
    queries = points if at is None else points[at]
    _, nearest = cKDTree(points).query(queries, k=min(max(neighbours, 3), len(points)))
    arms = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.swapaxes(arms, -1, -2) @ arms)
    normals = axes[..., 0]
    away = np.einsum("mi,mi->m", normals, viewpoint - queries) < 0.0
    return np.where(away[:, None], -normals, normals)
