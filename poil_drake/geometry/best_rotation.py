"""The rotation closest to a 3 x 3 matrix, fast enough for every control tick."""

import math
from collections.abc import Sequence

import numpy as np

_WELL_CONDITIONED = 1e-3
"""Least zeta / lambda^3 for the closed form, whose rounding errors grow with its inverse.

It is 0.25 or more for points that spread about equally in two directions, 0 for collinear points.
"""

_NEWTON_STEPS = 12
"""About five are enough if the rotation is well determined."""

_CONVERGED = 1e-8
"""Size of a step, relative to lambda, after which the quadratically falling error is negligible."""


def best_rotation(rows: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """Returns the rotation R, row by row, with the largest tr(R^T B), for the three rows of B.

    With B = sum_i w_i y_i x_i^T it minimises sum_i w_i |y_i - R x_i|^2, as `kabsch` does. If it is
    well determined, it is computed by Markley's FOAM (1993), which needs no decomposition:

        R = ((kappa + |B|^2) B + lambda cof B - B B^T B) / zeta,
        kappa = (lambda^2 - |B|^2) / 2,  zeta = kappa lambda - det B,

    with the largest root lambda of (lambda^2 - |B|^2)^2 - 8 lambda det B - 4 |cof B|^2, which is
    the sum of B's singular values, the least of them negative if det B is. Newton's method finds it
    from above; the derivative is 8 zeta. Computing with floats takes less time than a LAPACK call.
    Otherwise it is computed by the SVD of Kabsch (1976).
    """
    (a, b, c), (d, e, f), (g, h, i) = rows
    # cof B, in capitals, with J for i.
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    D, E, F = c * h - b * i, a * i - c * g, b * g - a * h
    G, H, J = b * f - c * e, c * d - a * f, a * e - b * d
    determinant = a * A + b * B + c * C
    # B B^T.
    p, q, r = a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i
    s, t, u = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
    square = p + q + r
    cofactors = A * A + B * B + C * C + D * D + E * E + F * F + G * G + H * H + J * J
    # lambda^2 = |B|^2 + 2 sqrt(|cof B|^2 + 2 lambda det B) is at most 3 |B|^2, a start from above.
    doubled = 2.0 * max(determinant, 0.0)
    root = math.sqrt(square + 2.0 * math.sqrt(cofactors + doubled * math.sqrt(3.0 * square)))
    root = math.sqrt(square + 2.0 * math.sqrt(cofactors + doubled * root))
    for _ in range(_NEWTON_STEPS):
        excess = root * root - square
        zeta = 0.5 * excess * root - determinant
        if not zeta > _WELL_CONDITIONED * root * root * root:
            break
        step = (excess * excess - 8.0 * root * determinant - 4.0 * cofactors) / (8.0 * zeta)
        root -= step
        if abs(step) <= _CONVERGED * root:
            kappa = 0.5 * (root * root - square)
            zeta, total = kappa * root - determinant, kappa + square
            p, q, r = total - p, total - q, total - r
            scale = 1.0 / zeta
            return (
                (p * a - s * d - t * g + root * A) * scale,
                (p * b - s * e - t * h + root * B) * scale,
                (p * c - s * f - t * i + root * C) * scale,
                (q * d - s * a - u * g + root * D) * scale,
                (q * e - s * b - u * h + root * E) * scale,
                (q * f - s * c - u * i + root * F) * scale,
                (r * g - t * a - u * d + root * G) * scale,
                (r * h - t * b - u * e + root * H) * scale,
                (r * i - t * c - u * f + root * J) * scale,
            )
    U, _, Vt = np.linalg.svd(np.array(rows))
    if np.linalg.det(U @ Vt) < 0.0:  # A reflection.
        U[:, 2] *= -1.0
    return tuple((U @ Vt).ravel().tolist())
