"""How old the points may be that the field acts on, and how long its twist is held with them.

Near its goal the field is e' = -eta e for every component e of the offset: the centroid's, exactly,
and the small rotation's, in the body's frame, to first order, since A^-1 H(I) = I. With points that
are older than now it is a linear equation with delay, whose limits are known in closed form.
"""

from collections.abc import Callable

import numpy as np

from poil_drake.errors import InvalidValueError

LARGEST_DELAY_GAIN = np.pi / 2.0
"""The largest eta d for which e'(t) = -eta e(t - d) is stable: at it, e = cos(eta t)."""

LARGEST_DELAY_GAIN_WITHOUT_OVERSHOOT = 1.0 / np.e
"""The largest eta d for which e' = -eta e(t - d) falls without passing the goal. z + eta e^(-z d)
has a real root up to there: its minimum over z is (1 + log(eta d)) / d."""


def largest_delay_gain(periods: int) -> float:
    """Returns the h = eta dt below which e_{n+1} = e_n - h e_{n-k} is stable, k = periods.

    2 sin(pi / (2 (2 k + 1))) (Levin and May 1976): on the circle z = exp(i t), z^(k+1) - z^k = -h
    has |z - 1| = 2 sin(t / 2) = h and the angle k t + (pi + t) / 2 = pi, first at
    t = pi / (2 k + 1). 2 without delay, 1 for one period; times k it goes to pi / 2.

    Args:
        periods: How many periods old the points are when the twist's hold begins.
    """
    return float(2.0 * np.sin(np.pi / (2.0 * (2.0 * _not_negative(periods) + 1.0))))


def largest_delay_gain_without_overshoot(periods: int) -> float:
    """Returns the largest h for which e_{n+1} = e_n - h e_{n-k} stays on its side of the goal.

    k^k / (k + 1)^(k + 1). z^(k+1) - z^k + h has a positive root up to there, the minimum of
    z^k (z - 1) being at z = k / (k + 1). From rest (all earlier e alike) no e falls below k/(k + 1)
    of the one before: by induction e_{n-k} <= ((k + 1) / k)^k e_n, so e_{n+1} >= k / (k + 1) e_n.
    Above it every solution passes the goal. 1 without delay, 1/4 for one period.

    Args:
        periods: How many periods old the points are when the twist's hold begins.
    """
    k = _not_negative(periods)
    return float((k / (k + 1.0)) ** k / (k + 1.0))


def delayed_loop_roots(gain: float, periods: float) -> np.ndarray:
    """Returns the roots z of the loop that samples, waits and holds; stable where all |z| < 1.

    Points are sampled every dt, arrive d = (k + f) dt later, 0 <= f < 1, and the twist from them is
    held until the next arrive. Over a period the first f dt pass with the twist before last:

        e_{n+1} = e_n - h ((1 - f) e_{n-k} + f e_{n-k-1}),    h = eta dt.

    Args:
        gain: h.
        periods: d / dt, not negative.
    """
    k = int(_not_negative(periods))
    fraction = periods - k
    # Powers of z from k + 2 down.
    coefficients = np.zeros(k + 3)
    coefficients[:2] = 1.0, -1.0
    coefficients[-2] += gain * (1.0 - fraction)
    coefficients[-1] += gain * fraction
    return np.roots(coefficients)


def delayed_loop_limits(periods: float) -> tuple[float, float]:
    """Returns the largest h without overshoot and the largest stable one, for any delay.

    For a whole number of periods both are the closed forms above; between, they are found from
    `delayed_loop_roots` by bisection.

    Args:
        periods: Delay over sampling period, not negative.
    """

    def stable(h: float) -> bool:
        return bool(np.max(np.abs(delayed_loop_roots(h, periods))) < 1.0)

    def positive(h: float) -> bool:
        # A double root comes out of np.roots with an imaginary part of about sqrt(rounding).
        roots = delayed_loop_roots(h, periods)
        return bool(np.any((np.abs(roots.imag) < 1e-7) & (roots.real > 1e-9)))

    return _bisect(positive), _bisect(stable)


def _bisect(holds: Callable[[float], bool]) -> float:
    """Returns the largest h in [0, 2.5] up to which a condition holds that fails from there on."""
    low, high = 0.0, 2.5
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _not_negative(periods: float) -> float:
    if not periods >= 0.0:
        raise InvalidValueError(
            f"The delay is {periods} periods.", remedy="Pass a delay that is not negative."
        )
    return periods
