"""How the flow leaves its three saddles: the linear rates and the time.

The setting is that of `stability`: target R = I, R' = R [omega(R)], eta = 1. For another eta, rates
are multiplied and times divided by it.
"""

from itertools import permutations

import numpy as np

from poil_drake.control.theory.stability import regular_eigenvalues
from poil_drake.errors import InvalidValueError


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

    So the fastest escape from every saddle has rate 1 for all points.

    Raises:
        InvalidValueError: if W belongs to collinear points.
    """
    eigenvalues = regular_eigenvalues(W)
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

    Raises:
        InvalidValueError: if the rate is not positive.
    """
    if not rate > 0.0:
        raise InvalidValueError(
            f"escape_time() got a rate of {rate} 1/s.",
            remedy="Pass a positive rate; with any other the flow does not leave the saddle.",
        )
    return np.log(np.tan(0.5 * end) / np.tan(0.5 * np.asarray(start))) / rate
