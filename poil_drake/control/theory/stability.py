"""The stability analysis of POIL, section III-B: the field around its goal.

The setting is the paper's: the points x_i = R x_i^b of a rigid object are centred, the target is
R = I, the reference is at rest, and eta = 1. Angular velocities are in the body's frame, so that
R' = R [omega].
"""

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import vee


def moment_matrix(points: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Returns W = sum_i w_i x_i x_i^T (3, 3) [m^2] of points (N, 3) about their centroid.

    The weights (N,) are all 1 by default.
    """
    w = np.ones(len(points)) if weights is None else weights
    x = points - (w / w.sum()) @ points
    return (x * w[:, None]).T @ x


def point_inertia(W: np.ndarray) -> np.ndarray:
    """Returns A = tr(W) I - W (3, 3) [m^2], the inertia of points with masses w_i."""
    return np.trace(W) * np.eye(3) - W


def regular_eigenvalues(W: np.ndarray) -> np.ndarray:
    """Returns the eigenvalues (3,) of W [m^2], in ascending order and not negative.

    Raises:
        InvalidValueError: if W belongs to collinear points, which do not determine a rotation.
    """
    eigenvalues = np.linalg.eigvalsh(W)
    if eigenvalues[0] + eigenvalues[1] <= 1e-12 * eigenvalues[2]:
        raise InvalidValueError(
            f"W has the eigenvalues {eigenvalues}: its points are collinear.",
            remedy="Pass the moments of points that are not collinear.",
        )
    return np.maximum(eigenvalues, 0.0)


def rotation_potential(W: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Returns D(R) = tr(W) - tr(W R) [m^2] of rotations (..., 3, 3)."""
    return np.trace(W) - np.einsum("ij,...ji->...", W, R)


def rotation_velocity(W: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Returns omega(R) = A^-1 (R^T W - W R)^vee (..., 3) [1/s], body frame, at rotations R.

    The closed form of the least-squares fit of POIL eq. 3 to v_i = x_i^b - R x_i^b.
    """
    skew_part = vee(np.swapaxes(R, -1, -2) @ W - W @ R)
    return np.linalg.solve(point_inertia(W), skew_part[..., None])[..., 0]


def critical_rotations(W: np.ndarray) -> np.ndarray:
    """Returns the rotations (3, 3, 3) other than the goal where omega vanishes: turns by pi.

    The k-th turns about the k-th principal axis of W, in ascending order of the eigenvalues. For
    distinct eigenvalues there are no others (theorem 1 of POIL).

    Raises:
        InvalidValueError: if two eigenvalues are equal.
    """
    eigenvalues, axes = np.linalg.eigh(W)
    if np.min(np.diff(eigenvalues)) <= 1e-9 * eigenvalues[-1]:
        raise InvalidValueError(
            f"W has the eigenvalues {eigenvalues}, of which two are equal: its critical rotations "
            "are not isolated.",
            remedy="Pass the moments of points without rotational symmetry.",
        )
    outer = np.einsum("ik,jk->kij", axes, axes)
    return 2.0 * outer - np.eye(3)
