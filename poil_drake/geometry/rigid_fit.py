"""The rigid transform that best maps one point set onto another."""

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import make_transform, skew


def _rotation_terms() -> np.ndarray:
    """Returns the matrix (16, 9) that maps the products q_a q_b of a quaternion q to its rotation.

    With q = (w, u), the rotation is R = (w^2 - |u|^2) I + 2 u u^T + 2 w [u].
    """
    identity = np.eye(3)
    terms = np.zeros((4, 4, 3, 3))
    terms[0, 0] = identity
    terms[0, 1:] = terms[1:, 0] = skew(identity)
    dyads = np.einsum("ai,bj->abij", identity, identity)
    terms[1:, 1:] = dyads + dyads.swapaxes(0, 1) - np.einsum("ab,ij->abij", identity, identity)
    return terms.reshape(16, 9)


_ROTATION_TERMS = _rotation_terms()


def kabsch(source: np.ndarray, target: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Returns the rigid X (..., 4, 4) with the least sum_i w_i |target_i - X source_i|^2.

    This is the problem of Kabsch (1976). If the points do not determine the rotation, because there
    are fewer than 3 or because they are collinear, one of the best rotations is returned.

    Args:
        source: (..., N, 3) points [m].
        target: (..., N, 3) their targets [m].
        weights: (..., N) non-negative; None for equal weights. A point of weight zero may be NaN.

    Raises:
        InvalidValueError: if the shapes disagree, if a weight is negative or NaN, or if all weights
            are zero.
    """
    source = np.asarray(source, dtype=float)
    target = np.asarray(target, dtype=float)
    w = np.ones(source.shape[-2]) if weights is None else np.asarray(weights, dtype=float)
    total = np.sum(w, axis=-1, keepdims=True)
    if not source.shape[-2:] == target.shape[-2:] == (*w.shape[-1:], 3):
        raise InvalidValueError(
            f"kabsch() got points of the shapes {source.shape} and {target.shape} and weights of "
            f"the shape {w.shape}.",
            remedy="Pass two sets (N, 3) of corresponding points and N weights.",
        )
    if not (np.all(w >= 0.0) and np.all(total > 0.0)):
        raise InvalidValueError(
            f"kabsch() got the weights {w}.", remedy="Pass non-negative weights, not all zero."
        )
    if weights is not None:
        # Points that were not observed are NaN, and NaN times zero is NaN.
        source = np.where(w[..., None] > 0.0, source, 0.0)
        target = np.where(w[..., None] > 0.0, target, 0.0)
    row = (w / total)[..., None, :]
    source_centroid, target_centroid = row @ source, row @ target
    R = _best_rotation((target - target_centroid).mT * row @ (source - source_centroid))
    return make_transform(R, (target_centroid - source_centroid @ R.mT)[..., 0, :])


def squared_motion_errors(source: np.ndarray, target: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Returns the squared residuals (..., N) [m^2] that the rigid motion of `kabsch` leaves.

    Args:
        source: (..., N, 3) finite points [m].
        target: (..., N, 3) their finite targets [m].
        shares: (..., N) weights that add up to 1.
    """
    row = shares[..., None, :]
    x, y = source - row @ source, target - row @ target
    errors = x @ _best_rotation(y.mT * row @ x).mT - y
    return np.vecdot(errors, errors)


def _best_rotation(covariance: np.ndarray) -> np.ndarray:
    """Returns the rotations R with the largest tr(R^T B), for B (..., 3, 3).

    Horn's method (1987): R is quadratic in a unit quaternion q, so tr(R^T B) = q^T K q, which is
    largest for the eigenvector of the largest eigenvalue of K. Unlike the SVD of Kabsch (1976), it
    gives no reflections.
    """
    leading = covariance.shape[:-2]
    K = covariance.reshape((*leading, 9)) @ _ROTATION_TERMS.T
    q = np.linalg.eigh(K.reshape((*leading, 4, 4)))[1][..., -1]
    products = (q[..., :, None] * q[..., None, :]).reshape((*leading, 16))
    return (products @ _ROTATION_TERMS).reshape((*leading, 3, 3))
