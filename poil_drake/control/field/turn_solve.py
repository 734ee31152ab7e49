"""The angular velocity that best fits the velocities of points, from their sums."""

import math

import numpy as np

from poil_drake.geometry.centred_sums import CentredSums

_WELL_CONDITIONED = 1e-4
"""Least det A / tr(W)^3 for the closed form, whose rounding errors grow with its inverse.

It is about the squared ratio of the points' distances from their best-fitting line to their
distances along it, so a ratio of 1 % is enough.
"""

_MINUS_IDENTITY = (-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0)

Vector = tuple[float, float, float]


def twist_turn(sums: CentredSums, min_rotation_spread: float = 0.0) -> tuple[Vector, float]:
    """Returns omega [rad/s] of the twist that best fits the velocities, and the points' spread [m].

    Args:
        sums: Sums of the points [m] and their velocities [m/s]; more may follow.
        min_rotation_spread: See `fit_twist`.
    """
    # The sums of r x v are the skew part of the sum of r v^T.
    (xx, xy, xz, _, s01, s02, *_), (_, yy, yz, s10, _, s12, *_), (_, _, zz, s20, s21, *_) = (
        sums.sums
    )
    moment = (s12 - s21, s20 - s02, s01 - s10)
    # Sums are means times the sum of the weights, and lengths scale with its root.
    root = math.sqrt(sums.total)
    omega, spread = solve_turn((xx, xy, xz, yy, yz, zz), moment, root * min_rotation_spread)
    return omega, spread / root


def twist_squares(sums: CentredSums, omega: Vector) -> np.ndarray:
    """Returns the squared residuals (N,) [m^2/s^2] of the twist with the mean velocity.

    Args:
        sums: Sums of the points [m] and their velocities [m/s]; more may follow.
        omega: Angular velocity [rad/s].
    """
    x, y, z = omega
    # r [-omega] = (omega x r)^T for a row r; less the velocity.
    return sums.combine((0.0, z, -y, -z, 0.0, x, y, -x, 0.0, *_MINUS_IDENTITY))


def solve_turn(
    second_moments: tuple[float, float, float, float, float, float],
    moment: Vector,
    min_rotation_spread: float = 0.0,
) -> tuple[Vector, float]:
    """Solves A omega = m; returns omega and the points' spread.

    A = tr(W) I - W for W = sum_i w_i r_i r_i^T and m = sum_i w_i r_i x v_i, with weights w_i and
    positions r_i about the centroid. A has W's axes; its eigenvalue on each is the sum of W's other
    two. Axes that the points are closer to than `min_rotation_spread` are treated as in
    `fit_twist`. There is no turn about an axis on which all points lie.

    Cramer's rule with floats takes less time than a call of LAPACK, so W is decomposed only if the
    points are too close to a line.

    Args:
        second_moments: W's xx, xy, xz, yy, yz, zz [m^2].
        moment: m [m^2/s].
        min_rotation_spread: [m], times the root of the weights' sum.

    Returns:
        omega: [rad/s].
        spread: Root mean square distance of the points from their best-fitting line [m], times the
            root of the weights' sum.
    """
    xx, xy, xz, yy, yz, zz = second_moments
    trace = xx + yy + zz
    a, b, c = yy + zz, xx + zz, xx + yy  # A's diagonal; -xy, -xz and -yz are off it.
    # The adjugate of A.
    p, q, r = b * c - yz * yz, a * c - xz * xz, a * b - xy * xy
    s, t, u = xz * yz + xy * c, xy * yz + b * xz, xy * xz + a * yz
    determinant = a * p - xy * s - xz * t
    if determinant > _WELL_CONDITIONED * trace * trace * trace:
        squared_spread = trace - largest_eigenvalue(second_moments)
        if squared_spread >= min_rotation_spread * min_rotation_spread:
            x, y, z = moment
            omega = (
                (p * x + s * y + t * z) / determinant,
                (s * x + q * y + u * z) / determinant,
                (t * x + u * y + r * z) / determinant,
            )
            return omega, math.sqrt(squared_spread)
    return solve_turn_by_axes(second_moments, moment, min_rotation_spread)


def solve_turn_by_axes(
    second_moments: tuple[float, float, float, float, float, float],
    moment: Vector,
    min_rotation_spread: float = 0.0,
) -> tuple[Vector, float]:
    """Solves the same equation as `solve_turn` by the eigenvalues and axes of W."""
    xx, xy, xz, yy, yz, zz = second_moments
    eigenvalues, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    low, middle, high = eigenvalues.tolist()
    # About the points' line A is zero up to rounding, so there is no rotation about it.
    rounding = 1e-12 * (middle + high)
    floor, sums = min_rotation_spread**2, (middle + high, low + high, low + middle)
    gains = [max(g, floor) if g > rounding else math.inf for g in sums]
    x, y, z = axes.dot(np.array(moment).dot(axes) / np.array(gains)).tolist()
    return (x, y, z), math.sqrt(max(low + middle, 0.0))


def largest_eigenvalue(
    second_moments: tuple[float, float, float, float, float, float],
) -> float:
    """Returns the largest eigenvalue of W up to the rounding of its trace.

    About its mean eigenvalue m = tr(W) / 3, W has the eigenvalues 2 p cos(phi + 2 k pi / 3) with
    6 p^2 = |W - m I|^2 and cos(3 phi) = det(W - m I) / (2 p^3) (Smith 1961).
    """
    xx, xy, xz, yy, yz, zz = second_moments
    mean = (xx + yy + zz) / 3.0
    x, y, z = xx - mean, yy - mean, zz - mean
    xy2, xz2, yz2 = xy * xy, xz * xz, yz * yz
    p2 = (x * x + y * y + z * z + 2.0 * (xy2 + xz2 + yz2)) / 6.0
    p = math.sqrt(p2)
    cubed = 2.0 * p2 * p
    if cubed == 0.0:
        return mean
    determinant = x * (y * z - yz2) - z * xy2 - y * xz2 + 2.0 * xy * xz * yz
    cosine = min(max(determinant / cubed, -1.0), 1.0)
    return mean + 2.0 * p * math.cos(math.acos(cosine) / 3.0)
