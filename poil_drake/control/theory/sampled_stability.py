"""How long the field's twist may be held before the potential rises.

A controller holds its twist for a period dt. The object then turns by h omega(R) (the exponential
map; h = eta dt, omega at eta = 1) about its centroid, and the centroid moves straight, so that its
offset e becomes (1 - h) e. The setting is that of `stability`.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.control.theory.stability import (
    point_inertia,
    regular_eigenvalues,
    rotation_velocity,
)
from poil_drake.geometry.rigid_transform import rotation_exp

WORST_SAMPLING_GAIN = np.pi / 2.0
"""The smallest value of `largest_sampling_gain` over all sets of points, which collinear points
approach. It was found by search. The proven bound, `proven_sampling_gain`, is never below 1.351."""


def sampling_gain_limit(W: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Returns the h (...) below which holding the twist at rotations R (..., 3, 3) lowers D.

    The limit is exact. A turn by s about the fixed axis u of omega changes the potential D to

        D(s) = c - p cos s - q sin s,    p = tr(W R) - u^T W R u,    q = |omega| u^T A u,

    since exp(s [u]) = I + sin s [u] + (1 - cos s) [u]^2, and -q is the slope -omega^T A omega of D
    per radian. D falls up to s = atan2(q, p) and returns to its value at twice that, so
    h = 2 atan2(q, p) / |omega|. It is infinite where omega is zero, because nothing moves.
    """
    omega = rotation_velocity(W, R)
    speed = np.linalg.norm(omega, axis=-1)
    u = omega / np.where(speed > 0.0, speed, 1.0)[..., None]
    WR = W @ R
    p = np.trace(WR, axis1=-2, axis2=-1) - np.einsum("...i,...ij,...j->...", u, WR, u)
    q = speed * np.einsum("...i,ij,...j->...", u, point_inertia(W), u)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(speed > 0.0, 2.0 * np.arctan2(q, p) / speed, np.inf)


def largest_speed(W: np.ndarray) -> float:
    """Returns the largest |omega| over all rotations at eta = 1 [rad/s], which is below sqrt(2).

    A component d^T omega, |d| = 1, is tr(W R [y]) with y = A^-1 d. Its maximum over all rotations R
    is the sum of the singular values of [y] W, a matrix of rank two:

        |omega|^2 <= |y|^2 tr(W^2) - |W y|^2 + 2 |y| |adj(W) y|
                  = 1 + 2 (sqrt(sum_i m_i sum_i m_i c_i^2) - sum_i m_i c_i)

    in the principal frame, with the eigenvalues l of W, m_i = d_i^2 / (l_j + l_k)^2 and
    c_i = l_j l_k. This bound is concave in d_i^2, and largest for d in the plane of the first and
    the last axis:

        |omega|^2 <= 1 + l_2 (l_3 - l_1)^2 / ((l_1 + 2 l_2 + l_3) (2 l_1 l_3 + l_2 (l_1 + l_3))).

    The right-hand side is 1 for equal eigenvalues and approaches 2 for l_1 << l_2 << l_3.

    Raises:
        InvalidValueError: if W belongs to collinear points.
    """
    low, middle, high = regular_eigenvalues(W)
    excess = middle * (high - low) ** 2
    excess /= (low + 2.0 * middle + high) * (2.0 * low * high + middle * (low + high))
    return float(np.sqrt(1.0 + excess))


def proven_sampling_gain(W: np.ndarray) -> float:
    """Returns an eta dt below which D falls from every rotation: 2 atan(r) / r, r = largest_speed.

    With p and q of `sampling_gain_limit`, p <= u^T A u for every W and R (docs/control.md has the
    proof), hence q / p >= |omega|. Since 2 atan(|omega|) / |omega| falls with |omega|, the largest
    |omega| gives the bound. The bound is at least sqrt(2) atan(sqrt(2)) = 1.351, and pi / 2 for
    equal eigenvalues. `largest_sampling_gain` shows how conservative it is.
    """
    speed = largest_speed(W)
    return 2.0 * np.arctan(speed) / speed


def largest_sampling_gain(W: np.ndarray, *, starts: int = 4000) -> float:
    """Returns the largest eta dt for which D falls from every rotation, found by search.

    The result is the smallest `sampling_gain_limit` of random rotations, improved by a random
    search around the worst of them. Next to the goal the limit is 2, which is the result if the
    condition number of A is at most 4. For elongated sets of points the result is less, down to
    pi / 2 for points near a line.

    Args:
        W: (3, 3) moments of points that are not collinear [m^2].
        starts: Number of random rotations at the start.
    """
    regular_eigenvalues(W)
    rng = np.random.default_rng(0)
    R = Rotation.random(starts, rng=rng).as_matrix()
    limits = sampling_gain_limit(W, R)
    kept = np.argsort(limits)[:8]
    R, best = R[kept], limits[kept]
    rows = np.arange(len(R))
    # From half a radian down to the effect of rounding.
    for scale in np.geomspace(0.5, 1e-4, 24):
        tried = R[:, None] @ rotation_exp(scale * rng.normal(size=(len(R), 40, 3)))
        limits = sampling_gain_limit(W, tried)
        winners = np.argmin(limits, axis=1)
        better = limits[rows, winners] < best
        best = np.where(better, limits[rows, winners], best)
        R = np.where(better[:, None, None], tried[rows, winners], R)
    # For translation the limit is 2: |1 - eta dt| < 1.
    return float(min(np.min(best), 2.0))
