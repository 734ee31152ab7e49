"""How the flow leaves its three saddles: the linear rates, and the time that it takes.

The setting is that of `stability`: target R = I, R' = R [omega(R)], eta = 1. For another eta, rates
are eta times and times 1 / eta times those here.
"""

import numpy as np

from poil_drake.control.theory.stability import point_inertia
from poil_drake.errors import InvalidValueError


def escape_rates(W: np.ndarray) -> np.ndarray:
    """Returns the rates (3, 3) [1/s] at which the flow leaves each saddle; negative ones approach.

    Row k is the saddle R*_k of `critical_rotations`, column i a small rotation about the i-th
    principal axis of W, both in order of rising eigenvalues l.

    With R = R*_k exp([xi]), xi in the body's frame, R' = R [omega] gives xi' = omega to first
    order. D changes by -omega^T A xi under a small rotation xi, because omega is minus its gradient
    in the metric A, and by xi^T H xi to first order of its gradient, so that

        xi' = -A^-1 H(R*_k) xi,    H(R*_k) = tr(W R*_k) I - W R*_k.

    Both are diagonal in the principal frame: the rate is 1 about axis k itself, where H is
    -(l_i + l_j) and A is l_i + l_j, and (l_j - l_k) / (l_j + l_k) about another axis i, with j the
    third. A perturbation on the left, R = exp([zeta]) R*_k, has zeta = R*_k xi, which at most flips
    signs in that frame: the same rates.

    So the fastest way out of every saddle has rate 1, whatever the points are.

    Raises:
        InvalidValueError: if the points are on a line, about which no rotation is determined.
    """
    eigenvalues = np.linalg.eigvalsh(W)
    if not eigenvalues[1] > 1e-12 * eigenvalues[2]:
        raise InvalidValueError(
            f"The points of W with eigenvalues {eigenvalues} are on a line.",
            remedy="Pass the moments of points that are not.",
        )
    rates = np.eye(3)
    for k in range(3):
        for i in range(3):
            if i != k:
                j = 3 - i - k
                total = eigenvalues[j] + eigenvalues[k]
                rates[k, i] = (eigenvalues[j] - eigenvalues[k]) / total
    return rates


def linearised_flow(W: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Returns the matrix F (3, 3) [1/s] of xi' = F xi near a critical rotation R: -A^-1 H(R).

    xi is the small rotation in the body's frame, R exp([xi]).
    """
    WR = W @ R
    return -np.linalg.solve(point_inertia(W), np.trace(WR) * np.eye(3) - WR)


def escape_time(rate: float, start: float | np.ndarray, end: float) -> np.ndarray:
    """Returns how long the flow takes to turn from one angle off a saddle to another [s].

    The turns about a principal axis through a saddle are a path of the flow: there the angle s off
    the saddle obeys s' = rate sin s exactly, hence

        t = log(tan(end / 2) / tan(start / 2)) / rate,

    about (log(1 / start) + log(2 tan(end / 2))) / rate for a small start: it grows with the
    logarithm of the distance. About axis k from R*_k the path ends at the goal; about another axis
    i it ends at the saddle R*_j. In any other direction the part about axis k outgrows the rest.

    Args:
        rate: Of `escape_rates`, positive [1/s].
        start: Angles off the saddle at the start [rad], in (0, pi).
        end: Angle off the saddle at the end [rad], in (0, pi).
    """
    if not rate > 0.0:
        raise InvalidValueError(
            f"escape_time() got the rate {rate} / s.",
            remedy="Pass a positive rate: the flow does not leave the saddle along the others.",
        )
    return np.log(np.tan(0.5 * end) / np.tan(0.5 * np.asarray(start))) / rate
