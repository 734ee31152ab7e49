"""Point-set BCSDM: the closed-loop velocity field of POIL, section III-B."""

import enum
import math
from dataclasses import dataclass

import numpy as np

from poil_drake.control.bcsdm_config import BcsdmConfig
from poil_drake.control.closest_configuration import closest_configuration
from poil_drake.control.point_trajectory import PointTrajectory
from poil_drake.control.twist_fit import RobustTwist, fit_twist_ransac, fit_twist_to_inliers
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_consensus import rigid_inliers


class BcsdmStatus(enum.Enum):
    """What the field has to say besides a twist."""

    OK = enum.auto()
    """The twist drives the points along the reference."""

    LOST = enum.auto()
    """Too few points, or all on a line: the twist is zero."""

    GOAL = enum.auto()
    """The points are at the end of the reference, within the tolerance."""


@dataclass(frozen=True, eq=False)
class BcsdmOutput:
    """The field at one configuration.

    Attributes:
        omega: (3,) angular velocity of the object [rad/s, world]; zero when lost.
        v: (3,) velocity of the centroid [m/s, world]; zero when lost.
        centroid: (3,) weighted centroid of the points that the twist was fitted to [m, world].
        tau: Time of the closest configuration of the reference [s]. NaN when lost.
        index: Its nearest sample. -1 when lost.
        potential: D of POIL eq. 4 over the same points as the velocities [m^2]. NaN when lost.
        mean_error: Mean distance of the points from the closest configuration [m]. NaN when lost.
        goal_error: Mean distance of the points from the reference's end [m]. NaN when lost.
        point_velocities: (N, 3) the field at each point (POIL eq. 2) [m/s]; NaN where a point was
            not observed or, by the test of rigidity, is an outlier.
        inliers: (N,) bool, which points the twist was fitted to.
        status: See `BcsdmStatus`.
    """

    omega: np.ndarray
    v: np.ndarray
    centroid: np.ndarray
    tau: float
    index: int
    potential: float
    mean_error: float
    goal_error: float
    point_velocities: np.ndarray
    inliers: np.ndarray
    status: BcsdmStatus

    def __post_init__(self) -> None:
        for array in (self.omega, self.v, self.centroid, self.point_velocities, self.inliers):
            array.flags.writeable = False

    @property
    def twist(self) -> np.ndarray:
        """(6,) (omega [rad/s], v [m/s]) of the object at `centroid`, world."""
        return np.concatenate([self.omega, self.v])


def point_set_bcsdm(
    points: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    confidence: np.ndarray | None = None,
    previous_tau: float | None = None,
) -> BcsdmOutput:
    """Returns the rigid motion that drives the points along the reference (POIL eqs. 1 to 3).

    Each point wants v_i = x*'_i(tau) + eta (x*_i(tau) - x_i), with tau the closest configuration;
    the twist is the one that matches these velocities best. The speed is not limited here.

    Args:
        points: (N, 3) positions [m, world]; NaN where not observed.
        reference: The reference of the same N points.
        config: Parameters of the field.
        confidence: (N,) weights in [0, 1]; 0 leaves a point out, None weighs all alike.
        previous_tau: The last tick's tau [s], for the progress window; None or NaN for none.

    Raises:
        InvalidValueError: if the number of points is not the reference's.
    """
    if points.shape != reference.positions.shape[1:]:
        raise InvalidValueError(
            f"The points have shape {points.shape}, but the reference has "
            f"{reference.positions.shape[1:]}.",
            remedy="Pass the positions of the reference's points, in its order.",
        )
    weights = np.ones(len(points)) if confidence is None else confidence
    # NaN fails the comparison, so a confidence that is NaN leaves its point out as well.
    observed = (weights > 0.0) & (weights < np.inf) & np.isfinite(points.sum(axis=1))
    which: slice | np.ndarray = slice(None)
    x, w, positions = points, weights, reference.positions
    if not observed.all():
        which = np.flatnonzero(observed)
        x, w, positions = points[which], weights[which], positions.take(which, axis=1)
    if len(x) < 3:
        return _lost(len(points))
    segment, fraction = closest_configuration(
        x,
        positions,
        reference.times,
        w,
        interpolate=config.interpolate,
        window=config.progress_window,
        escape_ratio=config.window_escape_ratio,
        previous_tau=previous_tau,
    )
    errors = _interpolate(positions, segment, fraction) - x
    velocities = _interpolate(reference.velocities, segment, fraction)[which] + config.eta * errors
    fit, suspicious = _fit(x, velocities, w, config)
    if suspicious:
        inliers = rigid_inliers(x, x + errors, w, config=config.rigidity)
        if not inliers.all():
            # Outliers count for nothing, the closest configuration included.
            kept = np.zeros(len(points))
            kept[which] = w * inliers
            return point_set_bcsdm(points, reference, config, kept, previous_tau)
    if fit.spread < config.min_spread:
        return _lost(len(points))
    tau = float(_interpolate(reference.times, segment, fraction))
    total = float(w.sum())
    squares = np.einsum("ni,ni->n", errors, errors)
    goal_errors = positions[-1] - x
    goal_squares = np.einsum("ni,ni->n", goal_errors, goal_errors)
    goal_error = float(w @ np.sqrt(goal_squares)) / total
    at_goal = goal_error < config.goal_tolerance and tau >= reference.times[-1] - config.goal_window
    return BcsdmOutput(
        omega=fit.omega,
        v=fit.v,
        centroid=fit.centroid,
        tau=tau,
        index=segment + round(fraction),
        potential=0.5 * float(w @ squares),
        mean_error=float(w @ np.sqrt(squares)) / total,
        goal_error=goal_error,
        point_velocities=_for_all(velocities, observed, np.nan),
        inliers=_for_all(fit.inliers, observed, False),
        status=BcsdmStatus.GOAL if at_goal else BcsdmStatus.OK,
    )


def _fit(
    points: np.ndarray, velocities: np.ndarray, weights: np.ndarray, config: BcsdmConfig
) -> tuple[RobustTwist, bool]:
    """Returns the twist, and whether its residuals are large enough to look for outliers."""
    if config.outlier_test == "velocity":
        ransac, spread = config.ransac, config.min_rotation_spread
        fit = fit_twist_ransac(
            points, velocities, weights, config=ransac, min_rotation_spread=spread
        )
        return fit, False
    everyone = np.ones(len(points), dtype=bool)
    fit, squares = fit_twist_to_inliers(
        points, velocities, weights, everyone, config.min_rotation_spread
    )
    limit = (config.eta * config.rigidity.inlier_distance) ** 2
    return fit, config.outlier_test == "rigidity" and bool(squares.max() > limit)


def _interpolate(values: np.ndarray, segment: int, fraction: float) -> np.ndarray:
    if fraction == 0.0:
        return values[segment]
    return values[segment] + fraction * (values[segment + 1] - values[segment])


def _for_all(values: np.ndarray, observed: np.ndarray, fill: float | bool) -> np.ndarray:
    if len(values) == len(observed):
        return values
    full = np.full((len(observed), *values.shape[1:]), fill, dtype=values.dtype)
    full[observed] = values
    return full


def _lost(count: int) -> BcsdmOutput:
    return BcsdmOutput(
        omega=np.zeros(3),
        v=np.zeros(3),
        centroid=np.full(3, np.nan),
        tau=math.nan,
        index=-1,
        potential=math.nan,
        mean_error=math.nan,
        goal_error=math.nan,
        point_velocities=np.full((count, 3), np.nan),
        inliers=np.zeros(count, dtype=bool),
        status=BcsdmStatus.LOST,
    )
