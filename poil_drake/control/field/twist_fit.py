"""The twist that best fits the velocities of points; shifting and scaling twists."""

from typing import NamedTuple

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_fit import choose_triples, consensus
from poil_drake.geometry.rigid_transform import cross, skew

_CURL = -skew(np.eye(3)).reshape(3, 9)
"""(3, 9) cross products as matrix products, with 3 x 3 matrices flattened row by row: omega @ _CURL
is -[omega], and _CURL @ M is sum_i a_i x b_i for M = sum_i a_i b_i^T."""


_ROUNDING, _TINY = 1e-14, 1e-200
"""Added to the eigenvalues of A in `fit_twist`, as a fraction of tr(W) and in m^2, so that they are
positive for collinear points, too."""


class TwistFit(NamedTuple):
    """The twist that best fits the velocities of points.

    Attributes:
        omega: (..., 3) angular velocity [rad/s].
        v: (..., 3) velocity of the centroid [m/s].
        centroid: (..., 3) weighted centroid of the points [m].
        spread: (...) root mean square distance of the points from their best-fitting line [m]. If
            it is zero, the rotation about that line is not determined.
    """

    omega: np.ndarray
    v: np.ndarray
    centroid: np.ndarray
    spread: np.ndarray

    def squared_errors(self, points: np.ndarray, velocities: np.ndarray) -> np.ndarray:
        """Returns the squared residuals (..., N) [m^2/s^2] of the velocities of points."""
        omega, v, centroid = self.omega, self.v, self.centroid
        # omega x r = r^T [-omega] for a row r^T.
        spin = (omega @ _CURL).reshape((*omega.shape, 3))
        errors = (points - centroid[..., None, :]) @ spin
        errors += v[..., None, :] - velocities
        return np.vecdot(errors, errors)


def fit_twist(
    points: np.ndarray,
    velocities: np.ndarray,
    shares: np.ndarray,
    min_rotation_spread: float = 0.0,
) -> TwistFit:
    """Returns the twist that best fits the velocities of points.

    Minimises sum_i w_i |v + omega x (x_i - c) - v_i|^2 about the weighted centroid c (POIL eq. 3),
    where the normal equations decouple: v is the mean velocity, and A omega = sum_i w_i r_i x v_i
    with r_i = x_i - c, A = tr(W) I - W and W = sum_i w_i r_i r_i^T. If all points lie on one axis,
    omega has no component along this axis.

    About a principal axis from which the points are a root mean square distance s away, noise in
    the velocities is divided by s. If s is below s0 = `min_rotation_spread`, the rotation about
    this axis is scaled by (s / s0)^2. Noise is then divided by at least s0, and the rotation fades
    out as the points approach the axis. The potential D of POIL eq. 4 still falls, because the
    rotation about each axis lowers D separately.

    Args:
        points: (..., N, 3) positions [m].
        velocities: (..., N, 3) their velocities [m/s].
        shares: (..., N) weights w_i, which add up to 1.
        min_rotation_spread: s0 [m]; 0 for plain least squares.
    """
    row = shares[..., None, :]
    centroid, v = row @ points, row @ velocities
    arms = points - centroid
    weighted = arms.mT * row
    eigenvalues, axes = np.linalg.eigh(weighted @ arms)
    # A has the axes of W; its eigenvalue on each is the sum of the other two of W.
    trace = eigenvalues.sum(axis=-1, keepdims=True)
    gains = (1.0 + _ROUNDING) * trace + _TINY - eigenvalues
    spread = np.sqrt(gains[..., 2])
    if min_rotation_spread > 0.0:
        gains = np.maximum(gains, min_rotation_spread**2)
    products = weighted @ velocities
    moment = _CURL @ products.reshape((*products.shape[:-2], 9, 1))
    omega = axes @ ((axes.mT @ moment) / gains[..., None])
    return TwistFit(omega[..., 0], v[..., 0, :], centroid[..., 0, :], spread)


def twist_consensus(
    points: np.ndarray, velocities: np.ndarray, weights: np.ndarray, inlier_speed: float
) -> np.ndarray:
    """Returns which points have velocities that one twist explains, by `consensus`: (N,) bool.

    The velocities of POIL eq. 2 agree with one twist only near the reference. If the points are
    turned away from it by an angle t, the velocities contain a contraction of (1 - cos t) eta |r|.
    Once the contraction exceeds `inlier_speed`, true points look like outliers. `rigid_inliers`
    works at every angle.

    Args:
        points: (N, 3) positions [m].
        velocities: (N, 3) their velocities [m/s].
        weights: (N,) positive.
        inlier_speed: Largest residual of an inlier [m/s].
    """
    triples = choose_triples(points)
    proposed = fit_twist(points[triples], velocities[triples], np.full(triples.shape, 1.0 / 3.0))
    return consensus(
        triples,
        proposed.squared_errors(points, velocities).T,
        weights,
        inlier_speed**2,
        lambda shares: fit_twist(points, velocities, shares).squared_errors(points, velocities),
    )


def shift_twist(V_WP: np.ndarray, p_PQ: np.ndarray) -> np.ndarray:
    """Returns the spatial velocity (..., 6) of a body at Q, given its spatial velocity at P.

    Args:
        V_WP: (..., 6), (omega [rad/s], v [m/s]), world.
        p_PQ: (..., 3) from P to Q [m], world.
    """
    omega, v = V_WP[..., :3], V_WP[..., 3:]
    return np.concatenate([omega, v + cross(omega, p_PQ)], axis=-1)


def scale_twist(V: np.ndarray, max_angular_speed: float, max_linear_speed: float) -> np.ndarray:
    """Returns spatial velocities, each scaled by one factor so that it respects both limits.

    The motion becomes slower, but keeps its direction and its path, so D of POIL eq. 4 still falls.
    Limits on single axes would bend the path. A velocity that is not finite becomes zero.

    Args:
        V: (..., 6), (omega [rad/s], v [m/s]).
        max_angular_speed: Largest |omega| [rad/s], positive.
        max_linear_speed: Largest |v| [m/s], positive.

    Raises:
        InvalidValueError: if a limit is not positive.
    """
    if not (max_angular_speed > 0.0 and max_linear_speed > 0.0):
        raise InvalidValueError(
            f"scale_twist() got limits of {max_angular_speed} rad/s and {max_linear_speed} m/s.",
            remedy="Pass positive speed limits.",
        )
    V = np.where(np.isfinite(V.sum(axis=-1, keepdims=True)), V, 0.0)
    parts = V.reshape(*V.shape[:-1], 2, 3)
    speeds = np.sqrt(np.vecdot(parts, parts))
    excess = (speeds / [max_angular_speed, max_linear_speed]).max(axis=-1, keepdims=True)
    return V / np.maximum(1.0, excess)
