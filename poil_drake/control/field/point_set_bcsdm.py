"""Point-set BCSDM: the closed-loop velocity field of POIL, section III-B."""

import enum
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from poil_drake.control.field.bcsdm_config import BcsdmConfig
from poil_drake.control.field.closest_configuration import closest_configuration
from poil_drake.control.field.robust_fit import fit_robust_twist
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError


class BcsdmStatus(enum.Enum):
    """Status of the field at one configuration."""

    OK = enum.auto()
    """The twist drives the points along the reference."""

    LOST = enum.auto()
    """Fewer than three points, or all collinear; the twist is zero."""

    GOAL = enum.auto()
    """The points are within the tolerance of the reference's end."""


class BcsdmOutput(NamedTuple):
    """The field at one configuration; its arrays are read-only.

    Attributes:
        omega: (3,) angular velocity of the object [rad/s, world]; zero when lost.
        v: (3,) velocity of the centroid [m/s, world]; zero when lost.
        centroid: (3,) weighted centroid of the points that the twist was fitted to [m, world].
        tau: Time of the closest configuration of the reference [s]. NaN when lost.
        index: The sample nearest to it. -1 when lost.
        potential: D of POIL eq. 4 over the same points as the velocities [m^2]. NaN when lost.
        mean_error: Mean distance of the points from the closest configuration [m]. NaN when lost.
        goal_error: Mean distance of the points from the reference's end [m]. NaN when lost.
        point_velocities: (N, 3) the field at each point (POIL eq. 2) [m/s]; NaN for points that
            were not observed or are outliers by the rigidity test.
        inliers: (N,) bool, which points the twist was fitted to.
        status: See `BcsdmStatus`.
    """

    omega: np.ndarray
    v: np.ndarray
    centroid: np.ndarray
    tau: float
    index: int  # type: ignore[assignment]  # Hides tuple.index.
    potential: float
    mean_error: float
    goal_error: float
    point_velocities: np.ndarray
    inliers: np.ndarray
    status: BcsdmStatus

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

    The field at each point is v_i = x*'_i(tau) + eta (x*_i(tau) - x_i), with tau the time of the
    closest configuration; the twist fits these velocities best. The speed is not limited.

    Args:
        points: (N, 3) positions [m, world]; NaN where not observed.
        reference: The reference of the same N points.
        config: Parameters of the field.
        confidence: (N,) weights in [0, 1]; 0 excludes a point, None weights all equally.
        previous_tau: The last tick's tau [s], for the progress window; None or NaN for none.

    Raises:
        InvalidValueError: if the number of points or confidences differs from the reference's.
    """
    if points.shape != reference.positions.shape[1:]:
        raise InvalidValueError(
            f"The points have shape {points.shape}, but the reference has "
            f"{reference.positions.shape[1:]}.",
            remedy="Pass the positions of the reference's points, in its order.",
        )
    weights = np.ones(len(points)) if confidence is None else confidence
    if len(weights) != len(points):
        raise InvalidValueError(
            f"There are {len(weights)} confidences of {len(points)} points.",
            remedy="Pass one confidence for each point.",
        )
    numbers, flat = weights.tolist(), points.ravel()
    # A sum is finite only if all its terms are, and NaN fails every comparison.
    if numbers and min(numbers) > 0.0 and math.isfinite(sum(numbers) + flat.dot(flat)):
        return _field(points, weights, reference, config, previous_tau)
    observed = (weights > 0.0) & (weights < np.inf) & np.isfinite(points.sum(axis=1))
    # Points of weight zero are ignored, but must be finite.
    points = np.where(observed[:, None], points, 0.0)
    weights = np.where(observed, weights, 0.0)
    return _field(points, weights, reference, config, previous_tau)


def _field(
    points: np.ndarray,
    weights: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    previous_tau: float | None,
) -> BcsdmOutput:
    """Returns the field of finite points; those of weight zero are ignored."""
    numbers = weights.tolist()
    count = len(numbers) - numbers.count(0.0)
    if count < 3:
        return _lost(len(points))
    equal_weights = numbers.count(numbers[0]) == len(numbers)
    segment, fraction = closest_configuration(
        points,
        reference,
        None if equal_weights else weights,
        interpolate=config.interpolate,
        window=config.progress_window,
        escape_ratio=config.window_escape_ratio,
        previous_tau=previous_tau,
    )
    state = reference.states[segment]
    if fraction > 0.0:
        state = state + fraction * reference.state_steps[segment]
    errors = state[:2] - points  # To the closest configuration, and to the end.
    velocities = state[2] + config.eta * errors[0]
    fit = fit_robust_twist(
        points, velocities, state[0], weights, config, equal_weights=equal_weights
    )
    if config.outlier_test == "rigidity" and np.count_nonzero(fit.inliers) < count:
        # Outliers do not count for the closest configuration either.
        return _field(points, weights * fit.inliers, reference, config, previous_tau)
    if fit.spread < config.min_spread:
        return _lost(len(points))
    total = sum(numbers)
    tau = _time(reference.times, segment, fraction)
    squares = np.vecdot(errors, errors)
    distance, goal_distance = np.sqrt(squares).dot(weights).tolist()
    mean_error, goal_error = distance / total, goal_distance / total
    at_goal = goal_error < config.goal_tolerance and tau >= reference.times[-1] - config.goal_window
    if count < len(points):
        velocities[weights == 0.0] = np.nan
    velocities.setflags(write=False)
    return BcsdmOutput(
        omega=fit.omega,
        v=fit.v,
        centroid=fit.centroid,
        tau=tau,
        index=segment + round(fraction),
        potential=0.5 * float(weights.dot(squares[0])),
        mean_error=mean_error,
        goal_error=goal_error,
        point_velocities=velocities,
        inliers=fit.inliers,
        status=BcsdmStatus.GOAL if at_goal else BcsdmStatus.OK,
    )


def _time(times: np.ndarray, segment: int, fraction: float) -> float:
    start: float = times.item(segment)
    return start if fraction == 0.0 else start + fraction * (times.item(segment + 1) - start)


@lru_cache(maxsize=32)
def _lost(count: int) -> BcsdmOutput:
    output = BcsdmOutput(
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
    for array in (output.omega, output.v, output.centroid):
        array.setflags(write=False)
    output.point_velocities.setflags(write=False)
    output.inliers.setflags(write=False)
    return output
