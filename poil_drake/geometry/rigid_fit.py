"""The rigid transform that best maps one point set onto another."""

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import make_transform


def kabsch(source: np.ndarray, target: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Returns X (..., 4, 4) that minimises sum_i w_i |target_i - X source_i|^2.

    The method of Kabsch (1976) with Umeyama's guard against reflections. If the points do not
    determine the rotation (fewer than 3, or collinear), any one of the best rotations is returned.

    Args:
        source: (..., N, 3) points.
        target: (..., N, 3) their targets.
        weights: (..., N) non-negative; None for all equal. A point of weight zero may be NaN.

    Raises:
        InvalidValueError: if the shapes disagree, a weight is negative or NaN, or all are zero.
    """
    source = np.asarray(source, dtype=float)
    target = np.asarray(target, dtype=float)
    w = np.ones(source.shape[-2]) if weights is None else np.asarray(weights, dtype=float)
    total = np.sum(w, axis=-1, keepdims=True)
    shapes = (*w.shape[-1:], 3)
    if not source.shape[-2:] == target.shape[-2:] == shapes or not (
        np.all(w >= 0.0) and np.all(total > 0.0)
    ):
        raise InvalidValueError(
            f"kabsch() got a source of shape {source.shape}, a target of shape {target.shape} and "
            f"weights {w}.",
            remedy="Pass two sets (N, 3) of corresponding points and one non-negative weight for "
            "each, at least one positive.",
        )
    if weights is not None:
        # Points that were not observed are NaN, and NaN times zero is NaN.
        source = np.where(w[..., None] > 0.0, source, 0.0)
        target = np.where(w[..., None] > 0.0, target, 0.0)
    w = (w / total)[..., None]
    source_centroid = np.sum(w * source, axis=-2)
    target_centroid = np.sum(w * target, axis=-2)
    centred_target = np.swapaxes(target - target_centroid[..., None, :], -1, -2)
    covariance = centred_target @ (w * (source - source_centroid[..., None, :]))
    U, _, Vt = np.linalg.svd(covariance)
    signs = np.ones(U.shape[:-1])
    signs[..., 2] = np.where(np.linalg.det(U @ Vt) < 0.0, -1.0, 1.0)
    R = (U * signs[..., None, :]) @ Vt
    return make_transform(R, target_centroid - (R @ source_centroid[..., None])[..., 0])
