"""Stability of the field with delayed points and a sampled twist.

Near the goal, the field drives each component e of the object's offset by e' = -eta e. This is
exact for the centroid, and holds to first order for a small rotation in the body's frame. With
delayed points the equation becomes a linear delay equation.
"""

from collections.abc import Callable

import numpy as np

LARGEST_DELAY_GAIN = np.pi / 2.0
"""e'(t) = -eta e(t - d) is stable for eta d below this; at this value e = cos(eta t) persists."""

LARGEST_DELAY_GAIN_WITHOUT_OVERSHOOT = 1.0 / np.e
"""The largest eta d for which e' = -eta e(t - d) decays without overshooting the goal. Up to it,
z + eta e^(-z d) has a real root: its minimum over z is (1 + log(eta d)) / d."""


def delayed_loop_roots(gain: float, periods: float) -> np.ndarray:
    """Returns the roots z of the sampled and delayed loop, which is stable if all |z| < 1.

    Points are sampled every dt and arrive d = (k + f) dt later, 0 <= f < 1; their twist is held
    until the next points arrive. In the first f dt of each period the previous twist still acts:

        e_{n+1} = e_n - h ((1 - f) e_{n-k} + f e_{n-k-1}),    h = eta dt.

    Args:
        gain: h.
        periods: d / dt, not negative.
    """
    k = int(periods)
    fraction = periods - k
    # Powers of z from k + 2 down.
    coefficients = np.zeros(k + 3)
    coefficients[:2] = 1.0, -1.0
    coefficients[-2] += gain * (1.0 - fraction)
    coefficients[-1] += gain * fraction
    return np.roots(coefficients)


def delayed_loop_limits(periods: float) -> tuple[float, float]:
    """Returns the largest h without overshoot and the largest stable h, by bisection.

    For a whole number k of periods the first is k^k / (k + 1)^(k + 1), above which every solution
    passes the goal. The second is 2 sin(pi / (2 (2 k + 1))) (Levin and May 1976). docs/control.md
    has the proofs.

    Args:
        periods: Delay over sampling period, not negative.
    """

    def stable(h: float) -> bool:
        return bool(np.max(np.abs(delayed_loop_roots(h, periods))) < 1.0)

    def positive(h: float) -> bool:
        # np.roots returns double roots with an imaginary part of about sqrt(rounding).
        roots = delayed_loop_roots(h, periods)
        return bool(np.any((np.abs(roots.imag) < 1e-7) & (roots.real > 1e-9)))

    return _bisect(positive), _bisect(stable)


def _bisect(holds: Callable[[float], bool]) -> float:
    """Returns the largest h in [0, 2.5] up to which a condition holds."""
    low, high = 0.0, 2.5
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
