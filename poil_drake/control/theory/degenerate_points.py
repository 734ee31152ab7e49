"""How well a set of points determines a rotation."""

import enum
from typing import NamedTuple

import numpy as np

from poil_drake.control.theory.stability import moment_matrix

_MIN_SPREAD = 0.001
"""Points whose root mean square distance from a plane, a line or a point is below this count as
lying on it [m]. It is about a tracker's noise."""

_MIN_GAP = 0.05
"""Points have a rotational symmetry if the relative difference (l_j - l_i) / (l_j + l_i) of two
eigenvalues of W is below this. Times eta, the difference is the rate at which the field drifts
along the circle of nearly critical rotations; see `critical_rotations`."""


class PointSetShape(enum.Enum):
    """How many dimensions a set of points spans, in ascending order."""

    COINCIDENT = enum.auto()
    """One point: no rotation is determined. The field is LOST."""

    COLLINEAR = enum.auto()
    """A line: the rotation about it is not determined. The field is LOST if the points are closer
    to it than `BcsdmConfig.min_spread`, and slows this rotation below `min_rotation_spread`."""

    COPLANAR = enum.auto()
    """A plane: every rotation is determined, and the field's guarantee holds."""

    SPATIAL = enum.auto()
    """All three dimensions."""


class PointSetCondition(NamedTuple):
    """How well points determine a rotation, in their principal axes.

    Attributes:
        axes: (3, 3) the principal axes as columns, in ascending order of the eigenvalues l of
            W = sum_i w_i r_i r_i^T about the centroid.
        axis_distances: (3,) root mean square distance of the points from each axis [m]:
            sqrt((l_i + l_j) / sum_i w_i) about axis k.
        condition: Ratio of the largest to the smallest eigenvalue of A = tr(W) I - W,
            (l_2 + l_3) / (l_1 + l_2); infinite on a line. At least 1; 2 for points spread evenly
            in a plane.
        noise_per_error: (3,) standard deviation of the fitted small rotation about each axis [rad]
            per standard deviation of the points' coordinates [m]. It is 1 / sqrt(l_i + l_j) if all
            weights are 1, and infinite for rotations that are not determined.
        shape: See `PointSetShape`.
        symmetric: Whether two eigenvalues nearly agree, so that the critical rotations are nearly
            a circle. The field still converges from almost everywhere.
    """

    axes: np.ndarray
    axis_distances: np.ndarray
    condition: float
    noise_per_error: np.ndarray
    shape: PointSetShape
    symmetric: bool


def point_set_condition(points: np.ndarray, weights: np.ndarray | None = None) -> PointSetCondition:
    """Returns how well points determine a rotation.

    If every coordinate of v_i has noise of standard deviation sigma, the right-hand side of the
    normal equations A omega = sum_i w_i r_i x v_i of POIL eq. 3 has the covariance sigma^2 B, where
    B = sum_i w_i^2 (|r_i|^2 I - r_i r_i^T). Then omega has the covariance sigma^2 A^-1 B A^-1. The
    velocities of the field contain eta times the noise of the points, so its omega contains eta
    times the noise of a rotation fitted to the points.

    Args:
        points: (N, 3) [m], finite.
        weights: (N,) positive; None for all one.
    """
    w = np.ones(len(points)) if weights is None else weights
    eigenvalues, axes = np.linalg.eigh(moment_matrix(points, w))
    eigenvalues = np.maximum(eigenvalues, 0.0)
    low, middle, high = eigenvalues.tolist()
    inertia = np.array([middle + high, low + high, low + middle])
    rounding = 1e-12 * (middle + high)
    arms = (points - (w / w.sum()) @ points) @ axes
    squares = np.sum(arms**2, axis=1, keepdims=True) - arms**2
    spread = np.sqrt((w**2) @ squares)
    determined = inertia > rounding
    noise = np.where(determined, spread / np.where(determined, inertia, 1.0), np.inf)
    thickness = np.sqrt(np.cumsum(eigenvalues) / w.sum())
    # Root mean square distances from a plane, a line and a point, in ascending order.
    dimensions = np.count_nonzero(thickness >= _MIN_SPREAD)
    gaps = np.diff(eigenvalues) / np.maximum(eigenvalues[1:] + eigenvalues[:-1], 1e-300)
    return PointSetCondition(
        axes=axes,
        axis_distances=np.sqrt(inertia / w.sum()),
        condition=inertia[0] / inertia[2] if determined[2] else np.inf,
        noise_per_error=noise,
        shape=list(PointSetShape)[dimensions],
        symmetric=bool(gaps.min() < _MIN_GAP),
    )
