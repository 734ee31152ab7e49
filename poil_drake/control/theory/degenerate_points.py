"""How well a set of points determines a rotation, and what it leaves undetermined."""

import enum
from dataclasses import dataclass

import numpy as np

from poil_drake.control.theory.stability import moment_matrix
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array


class PointSetShape(enum.Enum):
    """In how many directions a set of points extends."""

    COINCIDENT = enum.auto()
    """One place: no rotation is determined. The field is LOST."""

    COLLINEAR = enum.auto()
    """A line: the rotation about it is not determined. The field is LOST below its `min_spread`,
    and slows that rotation below its `min_rotation_spread`."""

    COPLANAR = enum.auto()
    """A plane: every rotation is determined, and the field's guarantee holds as it stands."""

    SPATIAL = enum.auto()
    """All three directions."""


@dataclass(frozen=True, kw_only=True)
class PointSetConfig:
    """When a set of points counts as degenerate.

    Attributes:
        min_spread: Root mean square distance from a place, a line or a plane below which the points
            lie on it [m]. About a tracker's noise: less is not known.
        min_gap: Relative difference (l_j - l_i) / (l_j + l_i) of two eigenvalues of W below which
            the points have a rotational symmetry to the field. It is also the rate, over eta, at
            which the flow drifts along the circle of nearly critical rotations.
    """

    min_spread: float = 0.001
    min_gap: float = 0.05


@dataclass(frozen=True, eq=False)
class PointSetCondition(SharedOnCopy):
    """How well points determine a rotation, by their principal axes.

    Attributes:
        eigenvalues: (3,) of W = sum_i w_i r_i r_i^T about the centroid, rising [m^2].
        axes: (3, 3) the principal axes as columns.
        axis_distances: (3,) root mean square distance of the points from each axis [m]:
            sqrt((l_i + l_j) / sum_i w_i) about axis k.
        condition: Largest over smallest eigenvalue of A = tr(W) I - W, (l_2 + l_3) / (l_1 + l_2);
            infinite on a line. At least 1, and at most 2 for points spread evenly in a plane.
        noise_per_error: (3,) standard deviation of the fitted small rotation about each axis over
            that of each coordinate of each point [rad/m]: 1 / sqrt(l_i + l_j) where all weights
            are 1; infinite where nothing is determined.
        gaps: (2,) relative differences of neighbouring eigenvalues, see `PointSetConfig.min_gap`.
        shape: See `PointSetShape`.
        symmetric: Whether two eigenvalues agree: the critical rotations are not isolated. The field
            converges from almost everywhere all the same.
    """

    eigenvalues: np.ndarray
    axes: np.ndarray
    axis_distances: np.ndarray
    condition: float
    noise_per_error: np.ndarray
    gaps: np.ndarray
    shape: PointSetShape
    symmetric: bool

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[int, ...]] = {
            "eigenvalues": (3,),
            "axes": (3, 3),
            "axis_distances": (3,),
            "noise_per_error": (3,),
            "gaps": (2,),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            name_in_error = f"PointSetCondition.{name}"
            array = frozen_array(value, name=name_in_error, shape=shape, finite=False)
            object.__setattr__(self, name, array)


def point_set_condition(
    points: np.ndarray, weights: np.ndarray | None = None, config: PointSetConfig | None = None
) -> PointSetCondition:
    """Returns how well points determine a rotation.

    Noise of standard deviation sigma in every coordinate gives the normal equations
    A omega = sum_i w_i r_i x v_i of POIL eq. 3 a right-hand side of covariance sigma^2 B, where
    B = sum_i w_i^2 (|r_i|^2 I - r_i r_i^T), so omega has the covariance sigma^2 A^-1 B A^-1. The
    velocities of the field hold eta times the points' noise, and omega eta times that of a rotation
    fitted to the points.

    Args:
        points: (N, 3) [m].
        weights: (N,) positive; None for all one.
        config: When the set counts as degenerate; None for the defaults.
    """
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InvalidValueError(
            f"point_set_condition() got points of shape {points.shape}, or some not finite.",
            remedy="Pass finite positions (N, 3).",
        )
    config = config or PointSetConfig()
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
    # From a plane, a line and a place, in this order.
    flat = thickness < config.min_spread
    shape = PointSetShape.SPATIAL
    if flat[2]:
        shape = PointSetShape.COINCIDENT
    elif flat[1]:
        shape = PointSetShape.COLLINEAR
    elif flat[0]:
        shape = PointSetShape.COPLANAR
    gaps = np.array([_relative_gap(low, middle), _relative_gap(middle, high)])
    return PointSetCondition(
        eigenvalues=eigenvalues,
        axes=axes,
        axis_distances=np.sqrt(inertia / w.sum()),
        condition=inertia[0] / inertia[2] if determined[2] else np.inf,
        noise_per_error=noise,
        gaps=gaps,
        shape=shape,
        symmetric=bool(gaps.min() < config.min_gap),
    )


def _relative_gap(smaller: float, larger: float) -> float:
    return (larger - smaller) / (larger + smaller) if larger > 0.0 else 0.0
