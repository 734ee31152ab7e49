"""Point-set BCSDM: the closed-loop velocity field of POIL, section III-B."""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from poil_drake.control.field.twist_fit import fit_twist, twist_consensus
from poil_drake.control.reference.point_trajectory import PointTrajectory, closest_configuration
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_fit import rigid_consensus, squared_motion_errors

OutlierTest = Literal["rigidity", "velocity", "none"]


@dataclass(frozen=True, kw_only=True)
class BcsdmConfig:
    """Parameters of the field.

    Attributes:
        eta: Gain of the contraction towards the reference [1/s]. 3 is the paper's.
        interpolate: Whether the closest configuration may lie between samples. The paper takes the
            closest sample, which makes the field jump where the sample changes.
        progress_window: Search range (backward, forward) [s] for the closest configuration, around
            that of the last tick. With interpolation, the result may be up to one sample outside.
            None searches the whole reference, as in the paper. Then a disturbance can move the
            closest configuration anywhere, and so can noise where the reference comes near itself.
        window_escape_ratio: The search leaves the window if the potential D elsewhere is below this
            fraction of the smallest D in the window, because then the object has been moved. 0
            never leaves the window.
        goal_tolerance: Mean distance of the points from the reference's end below which they are
            at the goal [m]. 3 mm is about a tracker's noise over ten points plus the hand's lag.
        goal_window: At the goal the closest configuration must lie within this time of the
            reference's end [s], so that a motion that passes the goal earlier does not end there.
        min_spread: Smallest root mean square distance of the points from their best-fitting line
            that determines a rotation [m]. A mug's handle has 8 mm or more.
        min_rotation_spread: A rotation about an axis is slowed if the points' root mean square
            distance from the axis is below this [m], because noise dominates it. 0, as in the
            paper, never slows it. 2 mm keeps the effect of a tracker's noise of 1 mm over ten
            points below 10 deg.
        outlier_test: How mistracked points are found and excluded. "rigidity" excludes points that
            do not fit a rigid motion to the closest configuration, see `rigid_inliers`. "velocity"
            applies RANSAC to the velocities, as in the paper; after a large rotation away from the
            reference it takes true points for outliers. "none" keeps all points.
        inlier_distance: With "rigidity", largest distance of an inlier from where the motion puts
            it [m]. 5 mm is about five standard deviations of a tracker's noise.
        inlier_speed: With "velocity", largest residual of an inlier [m/s]. With eta = 3 / s a
            tracking error of 5 mm gives 0.015 m/s, a tracker's noise of 1 mm 0.003 m/s.
    """

    eta: float = 3.0
    interpolate: bool = True
    progress_window: tuple[float, float] | None = None
    window_escape_ratio: float = 0.25
    goal_tolerance: float = 0.003
    goal_window: float = 0.5
    min_spread: float = 0.001
    min_rotation_spread: float = 0.0
    outlier_test: OutlierTest = "rigidity"
    inlier_distance: float = 0.005
    inlier_speed: float = 0.015

    def __post_init__(self) -> None:
        if not self.eta > 0.0:
            raise InvalidValueError(
                f"BcsdmConfig.eta is {self.eta} 1/s.",
                remedy="Pass a positive gain; otherwise the field does not converge.",
            )
        if self.outlier_test not in get_args(OutlierTest):
            raise InvalidValueError(
                f"BcsdmConfig.outlier_test is '{self.outlier_test}'.",
                remedy=f"Choose one of {', '.join(get_args(OutlierTest))}.",
            )


class BcsdmStatus(enum.Enum):
    """Status of the field at one configuration."""

    OK = enum.auto()
    """The twist drives the points along the reference."""

    LOST = enum.auto()
    """Fewer than three points, or all collinear; the twist is zero."""

    GOAL = enum.auto()
    """The points are within the tolerance of the reference's end."""


class BcsdmOutput(NamedTuple):
    """The field at one configuration of the points, or at many along leading axes (...).

    Attributes:
        omega: (..., 3) angular velocity of the object [rad/s, world]; zero when lost.
        v: (..., 3) velocity of the centroid [m/s, world]; zero when lost.
        centroid: (..., 3) weighted centroid of the points that the twist was fitted to [m, world];
            NaN when lost.
        tau: (...) time of the closest configuration of the reference [s]; NaN when lost.
        potential: (...) D of POIL eq. 4 [m^2]; NaN when lost. D and the mean distances include the
            outliers of the "velocity" test, but not those of the "rigidity" test.
        mean_error: (...) mean distance of the points from the closest configuration [m]; NaN when
            lost.
        goal_error: (...) mean distance of the points from the reference's end [m]; NaN when lost.
        target_points: (..., N, 3) the closest configuration [m, world]; NaN when lost.
        inliers: (..., N) bool, which points the twist was fitted to; none when lost.
        status: A `BcsdmStatus`, or an array (...) of them.
    """

    omega: np.ndarray
    v: np.ndarray
    centroid: np.ndarray
    tau: Any
    potential: Any
    mean_error: Any
    goal_error: Any
    target_points: np.ndarray
    inliers: np.ndarray
    status: Any

    @property
    def twist(self) -> np.ndarray:
        """(..., 6) (omega [rad/s], v [m/s]) of the object at `centroid`, world."""
        return np.concatenate([self.omega, self.v], axis=-1)


_MIN_SPREAD = 1e-6
"""A smaller spread is a rounding error: the points are fewer than three, or collinear [m]."""

_STATUSES = np.array([BcsdmStatus.OK, BcsdmStatus.GOAL])
"""The status, indexed by whether the points are at the goal."""

_LOST: tuple[Any, ...] = (0.0, 0.0, *[np.nan] * 6, False, BcsdmStatus.LOST)
"""The fields of `BcsdmOutput` where the points do not determine a motion."""


def point_set_bcsdm(
    points: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    confidence: np.ndarray | None = None,
    previous_tau: np.ndarray | float | None = None,
) -> BcsdmOutput:
    """Returns the rigid motion that drives the points along the reference (POIL eqs. 1 to 3).

    The field at each point is v_i = x*'_i(tau) + eta (x*_i(tau) - x_i), with tau the time of the
    closest configuration. The twist fits these velocities best. The speed is not limited. Leading
    axes (...) index independent states, and the outputs have the same leading axes.

    Args:
        points: (..., N, 3) positions [m, world]; NaN where not observed.
        reference: The reference of the same N points.
        config: Parameters of the field.
        confidence: (..., N) weights in [0, 1]; 0 excludes a point, None weights all equally.
        previous_tau: (...) the last tick's tau [s], around which the progress window lies; None or
            NaN searches the whole reference.

    Raises:
        InvalidValueError: if the number of points or confidences differs from the reference's.
    """
    points = np.asarray(points, dtype=float)
    shape = reference.positions.shape[1:]
    weights = np.ones(points.shape[:-1]) if confidence is None else confidence
    if points.shape[-2:] != shape or weights.shape != points.shape[:-1]:
        raise InvalidValueError(
            f"point_set_bcsdm() got points of shape {points.shape} and confidences of shape "
            f"{weights.shape} for a reference with points of shape {shape}.",
            remedy="Pass the positions of the reference's points, in its order, and one confidence "
            "for each.",
        )
    observed = (weights > 0.0) & np.isfinite(points.sum(axis=-1) + weights)
    if np.count_nonzero(observed) < observed.size:
        # Points of weight zero are ignored, but must be finite.
        points = np.where(observed[..., None], points, 0.0)
        weights = np.where(observed, weights, 0.0)
    return _field(points, weights, observed, reference, config, previous_tau)


def _field(
    points: np.ndarray,
    weights: np.ndarray,
    observed: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    previous_tau: np.ndarray | float | None,
) -> BcsdmOutput:
    """Returns the field of finite points; only those `observed` have a weight above zero."""
    shares = _shares(weights)
    sample = closest_configuration(
        points,
        reference,
        shares,
        interpolate=config.interpolate,
        window=config.progress_window,
        escape_ratio=config.window_escape_ratio,
        previous_tau=previous_tau,
    )
    tau, target, velocities = reference.at_sample(sample)
    inliers = observed
    if config.outlier_test == "rigidity":
        above = observed & (
            squared_motion_errors(points, target, shares) > config.inlier_distance**2
        )
        if np.count_nonzero(above):
            find = partial(rigid_consensus, inlier_distance=config.inlier_distance)
            inliers = _inliers(above, observed, find, points, target, shares)
            if (inliers < observed).any():
                # Outliers do not count for the closest configuration either.
                return _field(points, weights * inliers, inliers, reference, config, previous_tau)
    errors = target - points
    velocities = velocities + config.eta * errors
    fit = fit_twist(points, velocities, shares, config.min_rotation_spread)
    if config.outlier_test == "velocity":
        above = observed & (fit.squared_errors(points, velocities) > config.inlier_speed**2)
        if np.count_nonzero(above):
            find = partial(twist_consensus, inlier_speed=config.inlier_speed)
            inliers = _inliers(above, observed, find, points, velocities, shares)
            kept = _shares(weights * inliers)
            fit = fit_twist(points, velocities, kept, config.min_rotation_spread)
    squares = np.vecdot(errors, errors)
    end_errors = reference.positions[-1] - points
    goal_error = np.vecdot(np.sqrt(np.vecdot(end_errors, end_errors)), shares)
    near_end = tau >= reference.times[-1] - config.goal_window
    at_goal = (goal_error < config.goal_tolerance) & near_end
    output = BcsdmOutput(
        omega=fit.omega,
        v=fit.v,
        centroid=fit.centroid,
        tau=tau,
        potential=0.5 * np.vecdot(squares, weights),
        mean_error=np.vecdot(np.sqrt(squares), shares),
        goal_error=goal_error,
        target_points=target,
        inliers=inliers,
        status=_STATUSES.take(at_goal),
    )
    lost = fit.spread < max(config.min_spread, _MIN_SPREAD)
    return _without(output, lost) if np.count_nonzero(lost) else output


def _without(output: BcsdmOutput, lost: np.ndarray) -> BcsdmOutput:
    """Returns the output with the values of `_LOST` at the states where `lost` (...) is true."""
    fields = []
    for values, nothing in zip(output, _LOST, strict=True):
        more = np.ndim(values) - lost.ndim
        fields.append(np.where(lost.reshape(lost.shape + (1,) * more), nothing, values)[()])
    return BcsdmOutput(*fields)


def _shares(weights: np.ndarray) -> np.ndarray:
    """Returns weights (..., N) that add up to 1; zeros if all are zero."""
    return weights / np.maximum(weights.sum(axis=-1, keepdims=True), 1e-300)


def _inliers(
    above: np.ndarray,
    observed: np.ndarray,
    find: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    *values: np.ndarray,
) -> np.ndarray:
    """Returns which points one motion explains: (..., N) bool.

    Args:
        above: (..., N) bool, the points whose error is too large under the best motion of all
            points. In states without any, all observed points are inliers.
        observed: (..., N) bool.
        find: Returns the inliers among the observed points of one state, given their values.
        values: The values, arrays (..., N, 3) or (..., N).
    """
    inliers = observed.copy()
    states = zip(*np.nonzero(above.any(axis=-1)), strict=True) if above.ndim > 1 else [()]
    for state in states:
        chosen = (*state, observed[state])
        inliers[chosen] = find(*(array[chosen] for array in values))
    return inliers
