"""The rotation nearest to a 3 x 3 matrix, quick enough for every control tick."""

import numpy as np

_WELL_CONDITIONED = 1e-3
"""Least zeta / lambda^3 for the closed form, whose rounding errors grow with its inverse.

It is 0.25 and more of points about as far spread in two directions, and zero of points on a line.
"""

_NEWTON_STEPS = 12
"""Two to six are enough where the rotation is well determined."""


def best_rotation(covariance: np.ndarray) -> np.ndarray:
    """Returns the rotation R (3, 3) with the largest tr(R^T B), for B = `covariance` (3, 3).

    With B = sum_i w_i y_i x_i^T it minimises sum_i w_i |y_i - R x_i|^2, as `kabsch` does. Where it
    is well determined, it comes from Markley's FOAM (1993), which needs no decomposition:

        R = ((kappa + |B|^2) B + lambda cof B - B B^T B) / zeta,
        kappa = (lambda^2 - |B|^2) / 2,  zeta = kappa lambda - det B,

    with the largest root lambda of (lambda^2 - |B|^2)^2 - 8 lambda det B - 4 |cof B|^2, which is
    the sum of B's singular values, the least of them negative where det B is. Newton's steps from
    above reach it; the derivative is 8 zeta. A dozen floats take less time than LAPACK's call.
    """
    (a, b, c), (d, e, f), (g, h, i) = covariance.tolist()
    # Cofactors.
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    D, E, F = c * h - b * i, a * i - c * g, b * g - a * h
    G, H, I = b * f - c * e, c * d - a * f, a * e - b * d
    determinant = a * A + b * B + c * C
    # B B^T.
    p, q, r = a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i
    s, t, u = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
    square = p + q + r
    cofactors = A * A + B * B + C * C + D * D + E * E + F * F + G * G + H * H + I * I
    root = (3.0 * square) ** 0.5
    for _ in range(_NEWTON_STEPS):
        excess = root * root - square
        zeta = 0.5 * excess * root - determinant
        if not zeta > _WELL_CONDITIONED * root * root * root:
            break
        step = (excess * excess - 8.0 * root * determinant - 4.0 * cofactors) / (8.0 * zeta)
        root -= step
        if step <= 1e-15 * root:
            kappa = 0.5 * (root * root - square)
            zeta, total = kappa * root - determinant, kappa + square
            p, q, r = total - p, total - q, total - r
            return (
                np.array(
                    (
                        (p * a - s * d - t * g + root * A),
                        (p * b - s * e - t * h + root * B),
                        (p * c - s * f - t * i + root * C),
                        (q * d - s * a - u * g + root * D),
                        (q * e - s * b - u * h + root * E),
                        (q * f - s * c - u * i + root * F),
                        (r * g - t * a - u * d + root * G),
                        (r * h - t * b - u * e + root * H),
                        (r * i - t * c - u * f + root * I),
                    )
                ).reshape(3, 3)
                / zeta
            )
    return best_rotation_by_svd(covariance)


def best_rotation_by_svd(covariance: np.ndarray) -> np.ndarray:
    """Returns what `best_rotation` does, by the method of Kabsch (1976)."""
    U, _, Vt = np.linalg.svd(covariance)
    R = U @ Vt
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    if a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0:  # A reflection.
        U[:, 2] *= -1.0
        R = U @ Vt
    return R
