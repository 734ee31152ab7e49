"""The twist of a control tick and the mistracked points."""

import math

import numpy as np

from poil_drake.control.field.bcsdm_config import BcsdmConfig
from poil_drake.control.field.turn_solve import twist_squares, twist_turn
from poil_drake.control.field.twist_fit import RobustTwist, everyone, fit_twist_ransac
from poil_drake.geometry.centred_sums import CentredSums, centred_sums
from poil_drake.geometry.rigid_consensus import consensus_inliers, motion_squares

_FAR_TURN = 0.25
"""Sine of the angle from the reference above which a twist always leaves large residuals."""


def fit_robust_twist(
    points: np.ndarray,
    velocities: np.ndarray,
    targets: np.ndarray,
    weights: np.ndarray,
    config: BcsdmConfig,
    *,
    equal_weights: bool,
) -> RobustTwist:
    """Returns the twist that best fits the velocities of points (POIL eq. 3), and its inliers.

    With the velocity test it is the inliers' twist. With the rigidity test it is the twist of all
    points, because outliers have influenced the closest configuration and so all velocities.

    Args:
        points: (N, 3) finite positions [m].
        velocities: (N, 3) their velocities [m/s].
        targets: (N, 3) their positions in the closest configuration [m].
        weights: (N,) zero for points that are not observed, positive for at least three others.
        config: Parameters of the field.
        equal_weights: Whether all weights are equal, which is faster.
    """
    observed = None if equal_weights or (known := weights > 0.0).all() else known
    if config.outlier_test == "velocity":
        return _fit_by_velocity(points, velocities, weights, observed, config)
    sums = centred_sums((points, velocities, targets), None if equal_weights else weights)
    omega, spread = twist_turn(sums, config.min_rotation_spread)
    inliers = everyone(len(points)) if observed is None else observed
    if config.outlier_test == "rigidity" and _may_have_outliers(sums, omega, observed, config):
        subset = slice(None) if observed is None else observed
        found = consensus_inliers(
            points[subset], targets[subset], weights[subset], config=config.rigidity
        )
        inliers = found if observed is None else _scattered(found, observed)
    return RobustTwist.of(sums, omega, inliers, spread)


def _fit_by_velocity(
    points: np.ndarray,
    velocities: np.ndarray,
    weights: np.ndarray,
    observed: np.ndarray | None,
    config: BcsdmConfig,
) -> RobustTwist:
    subset = slice(None) if observed is None else observed
    fit = fit_twist_ransac(
        points[subset],
        velocities[subset],
        weights[subset],
        config=config.ransac,
        min_rotation_spread=config.min_rotation_spread,
    )
    return fit if observed is None else fit._replace(inliers=_scattered(fit.inliers, observed))


def _scattered(inliers: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """Returns the read-only mask (N,) of all points for a mask (K,) of the observed ones."""
    mask = np.zeros(len(observed), dtype=bool)
    mask[observed] = inliers
    mask.setflags(write=False)
    return mask


def _may_have_outliers(
    sums: CentredSums,
    omega: tuple[float, float, float],
    observed: np.ndarray | None,
    config: BcsdmConfig,
) -> bool:
    """Returns whether both the best twist and the best motion leave some residual too large.

    Far from the reference in rotation the twist always does, so the motion is tested first.

    Args:
        sums: Of the points, their velocities and their targets.
        omega: Angular velocity of the twist that fits the velocities best [rad/s].
        observed: (N,) bool, the observed points; None for all.
        config: Parameters of the field.
    """
    distance = config.rigidity.inlier_distance
    if math.hypot(*omega) > _FAR_TURN * config.eta:
        return (
            _largest(motion_squares(sums), observed) > distance**2
            and _largest(twist_squares(sums, omega), observed) > (config.eta * distance) ** 2
        )
    return (
        _largest(twist_squares(sums, omega), observed) > (config.eta * distance) ** 2
        and _largest(motion_squares(sums), observed) > distance**2
    )


def _largest(squares: np.ndarray, observed: np.ndarray | None) -> float:
    return max((squares if observed is None else squares[observed]).tolist())
