"""The normal equations of a weighted least-squares step."""

import numpy as np

from poil_drake.geometry.rigid_transform import cross


def tukey_weights(residuals: np.ndarray, gate: float) -> np.ndarray:
    """Returns Tukey's biweights of residuals r: (1 - (r / gate)^2)^2, or 0 if |r| >= gate."""
    ratio = residuals / gate
    return np.where(np.abs(ratio) < 1.0, (1.0 - ratio * ratio) ** 2, 0.0)


def huber_weights(residuals: np.ndarray, threshold: float) -> np.ndarray:
    """Returns Huber's weights of residuals r: 1 if |r| <= threshold, else threshold / |r|."""
    return threshold / np.maximum(np.abs(residuals), threshold)


def motion_jacobian(points: np.ndarray, gradients: np.ndarray) -> np.ndarray:
    """Returns the derivatives of scalar functions of points with respect to a motion (ω, v).

    The motion takes a point q to q + ω x q + v.

    Args:
        points: (..., 3) the points q [m].
        gradients: (..., 3) or (3,) gradients g of the functions with respect to q.

    Returns:
        (..., 6) rows (q x g, g).
    """
    gradients = np.broadcast_to(gradients, points.shape)
    return np.concatenate([cross(points, gradients), gradients], axis=-1)


class NormalEquations:
    """The equations H d = b of a Gauss-Newton step, with H = sum w J^T J and b = sum w J^T r.

    The unknown d = (ω, v) moves the object in its own frame: a point q goes to q + ω x q + v. A
    residual r is a measured value minus its prediction. J is the derivative of the prediction with
    respect to d.

    Attributes:
        H: (6, 6) matrix.
        b: (6,) right-hand side.
        spurious: (6, 6) the expected part of H that is due to noise in J. Noisy normals, for
            instance, seem to determine how far a plain cylinder has turned.
    """

    def __init__(self) -> None:
        self.H = np.zeros((6, 6))
        self.b = np.zeros(6)
        self.spurious = np.zeros((6, 6))

    def add(self, jacobian: np.ndarray, residuals: np.ndarray, weights: np.ndarray) -> None:
        """Adds residuals (M,) with Jacobian rows (M, 6) and weights (M,)."""
        weighted = jacobian * weights[:, None]
        self.H += weighted.T @ jacobian
        self.b += residuals @ weighted

    def add_spurious(self, jacobian: np.ndarray, weights: np.ndarray) -> None:
        """Adds Jacobian errors, given as rows (M, 6) with weights (M,), to `spurious`."""
        self.spurious += (jacobian * weights[:, None]).T @ jacobian

    def information(self, length: float) -> np.ndarray:
        """Returns the information (6, 6) on the pose, the positive part of H - spurious.

        Args:
            length: Size of the object [m], which makes rotations and translations comparable.
        """
        scale = np.array([1.0 / length] * 3 + [1.0] * 3)
        values, vectors = np.linalg.eigh((self.H - self.spurious) * np.outer(scale, scale))
        kept = (vectors * np.maximum(values, 0.0)) @ vectors.T
        return kept / np.outer(scale, scale)
