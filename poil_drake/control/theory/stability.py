"""The stability analysis of POIL, section III-B: the field around its goal and its saddles.

The setting is the paper's: the points x_i = R x_i^b of a rigid object are centred, the target is
R = I, the reference is at rest, and eta = 1. Angular velocities are in the body's frame, so that
R' = R [omega]. For another eta, rates are multiplied and times divided by it.

A controller holds its twist for a period dt. The object then turns by h omega(R) (the exponential
map; h = eta dt) about its centroid, and the centroid moves straight, so that its offset e becomes
(1 - h) e.
"""

from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.geometry.rigid_transform import rotation_exp, vee

WORST_SAMPLING_GAIN = np.pi / 2.0
"""The smallest value of `largest_sampling_gain` over all sets of points, which collinear points
approach. It was found by search. The proven bound, `proven_sampling_gain`, is never below 1.351."""


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
    """
    _, axes = np.linalg.eigh(W)
    outer = np.einsum("ik,jk->kij", axes, axes)
    return 2.0 * outer - np.eye(3)


def escape_rates(W: np.ndarray) -> np.ndarray:
    """Returns the rates (3, 3) [1/s] at which the flow leaves each saddle; negative rates approach.

    Row k is the saddle R*_k of `critical_rotations`, column i a small rotation about the i-th
    principal axis of W, both in ascending order of the eigenvalues l.

    With R = R*_k exp([xi]), xi in the body's frame, R' = R [omega] gives xi' = omega to first
    order. The gradient of D is -A omega, and to first order it is H xi, so that

        xi' = -A^-1 H(R*_k) xi,    H(R*_k) = tr(W R*_k) I - W R*_k.

    A and H are diagonal in the principal frame. About axis k itself H is -(l_i + l_j) and A is
    l_i + l_j, so the rate is 1. About another axis i the rate is (l_j - l_k) / (l_j + l_k), with j
    the third axis. A perturbation on the left, R = exp([zeta]) R*_k, has zeta = R*_k xi, which only
    flips signs in the principal frame and has the same rates.

    So the fastest escape from every saddle has rate 1 for all points that are not collinear.
    """
    eigenvalues = np.maximum(np.linalg.eigvalsh(W), 0.0)
    rates = np.eye(3)
    for k, i, j in permutations(range(3)):
        rates[k, i] = (eigenvalues[j] - eigenvalues[k]) / (eigenvalues[j] + eigenvalues[k])
    return rates


def escape_time(rate: float, start: float | np.ndarray, end: float) -> np.ndarray:
    """Returns the time that the flow takes from one angle off a saddle to another [s].

    The turns about a principal axis through a saddle are a trajectory of the flow, on which the
    angle s off the saddle obeys s' = rate sin s exactly, hence

        t = log(tan(end / 2) / tan(start / 2)) / rate,

    about (log(1 / start) + log(2 tan(end / 2))) / rate for a small start, that is, logarithmic in
    the distance. About axis k from R*_k the trajectory ends at the goal, about another axis i at
    the saddle R*_j. In any other direction the component about axis k outgrows the others.

    Args:
        rate: One of `escape_rates`, positive [1/s].
        start: Angles off the saddle at the start [rad], in (0, pi).
        end: Angle off the saddle at the end [rad], in (0, pi).
    """
    return np.log(np.tan(0.5 * end) / np.tan(0.5 * np.asarray(start))) / rate


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
    """
    low, middle, high = np.maximum(np.linalg.eigvalsh(W), 0.0)
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
