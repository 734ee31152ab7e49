"""Surface normals of a cloud by principal component analysis of neighbourhoods."""

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.errors import InvalidValueError

_NEIGHBOURS = 16
"""Number of points in a neighbourhood, including the point itself."""


def pca_normals(
    points: np.ndarray,
    *,
    viewpoint: np.ndarray,
    at: np.ndarray | None = None,
) -> np.ndarray:
    """Returns unit normals of the surface on which points lie.

    A normal is the direction in which the nearest neighbours of a point spread least.

    Args:
        points: (P, 3) [m], at least 3.
        viewpoint: (3,) position from which the points were seen [m]. Normals point towards it.
        at: (M,) indices of the points to compute normals at; None for all.

    Returns:
        (M, 3) unit normals, or (P, 3) if `at` is None.

    Raises:
        InvalidValueError: if there are fewer than 3 points.
    """
    if len(points) < 3:
        raise InvalidValueError(
            f"pca_normals() got only {len(points)} points.", remedy="Pass at least 3 points."
        )
    queries = points if at is None else points[at]
    _, nearest = cKDTree(points).query(queries, k=min(_NEIGHBOURS, len(points)))
    arms = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.swapaxes(arms, -1, -2) @ arms)
    normals = axes[..., 0]
    away = np.einsum("mi,mi->m", normals, viewpoint - queries) < 0.0
    return np.where(away[:, None], -normals, normals)
