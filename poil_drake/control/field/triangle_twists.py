"""The twists that sets of three points propose."""

import numpy as np

from poil_drake.geometry.rigid_transform import skew
from poil_drake.geometry.triples import cross, triangle_corners

# The alternating symbol: [-omega] = _NEGATIVE_SKEW @ omega, also for many omega (3, K).
_NEGATIVE_SKEW = np.ascontiguousarray(np.moveaxis(skew(-np.eye(3)), 0, -1))


def triangle_twist_squares(
    points: np.ndarray, velocities: np.ndarray, triples: np.ndarray
) -> np.ndarray:
    """Returns the squared residuals (N, K) [m^2/s^2] that the twists of K triangles leave.

    Args:
        points: (N, 3) positions [m].
        velocities: (N, 3) their velocities [m/s].
        triples: (K, 3) indices of points that are not collinear.
    """
    omegas, vs, centroids = _fit_triangles(
        triangle_corners(points, triples), triangle_corners(velocities, triples)
    )
    # omega x x = x^T [-omega] for a row x^T: one matrix product for all points and triangles.
    spins = _NEGATIVE_SKEW @ omegas
    residuals = (points @ spins.reshape(3, -1)).reshape(len(points), 3, -1)
    residuals += vs - cross(omegas, centroids)
    residuals -= velocities[:, :, None]
    return np.einsum("nik,nik->nk", residuals, residuals)


def _fit_triangles(
    corners: np.ndarray, velocities: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns omega, v and the centroid, (3, K) each, of triangles (3, 3, K), coordinate first.

    Three points r_i about their centroid lie in a plane. With a normal n, m = sum_i r_i x v_i and
    W = sum_i r_i r_i^T the solution of A omega = m is W m / d in the plane, where d is the product
    of the eigenvalues of W there, and n (n . m) / (|n|^2 tr W) along n. For n = r_1 x r_2 (a third
    of the sides' product) Cauchy and Binet give d = 3 |n|^2.
    """
    centroids, vs = corners.sum(axis=1) / 3.0, velocities.sum(axis=1) / 3.0
    arms = corners - centroids[:, None]
    moments = cross(arms, velocities).sum(axis=1)
    normals = cross(arms[:, 0], arms[:, 1])
    traces = np.einsum("isk,isk->k", arms, arms)
    across = np.einsum("isk,sk->ik", arms, np.einsum("isk,ik->sk", arms, moments)) / 3.0
    along = normals * (np.einsum("ik,ik->k", normals, moments) / traces)
    return (across + along) / np.einsum("ik,ik->k", normals, normals), vs, centroids
