"""Reconstruction of each point of a cloud as a linear combination of its neighbours."""

import numpy as np
from scipy.spatial import cKDTree


def local_reconstruction_weights(
    points: np.ndarray, *, neighbours: int, regularization: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the neighbours of each point and the weights that reconstruct it from them.

    Locally linear embedding (Roweis and Saul, Science 2000): minimises |x_i - sum_j w_ij x_j|^2
    with sum_j w_ij = 1. The weights are invariant to affine maps of the cloud.

    Args:
        points: (P, 3) the cloud, P >= 2.
        neighbours: Number of neighbours, without the point itself; at most P - 1 are used.
        regularization: Ridge relative to the trace of the neighbourhood's Gram matrix.

    Returns:
        indices: (P, k) the neighbours.
        weights: (P, k) the weights; each row adds up to 1.
    """
    k = min(neighbours, len(points) - 1)
    _, indices = cKDTree(points).query(points, k=k + 1)
    # Where points coincide, the point itself need not be the first.
    is_self = indices == np.arange(len(points))[:, None]
    is_self[~is_self.any(axis=1), -1] = True
    indices = indices[~is_self].reshape(len(points), k)
    arms = points[indices] - points[:, None]
    gram = arms @ np.swapaxes(arms, 1, 2)
    ridge = regularization * np.trace(gram, axis1=1, axis2=2)
    gram = gram + np.maximum(ridge, 1e-15)[:, None, None] * np.eye(k)
    weights = np.linalg.solve(gram, np.ones((len(points), k, 1)))[..., 0]
    return indices, weights / weights.sum(axis=1, keepdims=True)
