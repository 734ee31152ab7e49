"""The twist that best fits the velocities of points; shifting and scaling twists."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from poil_drake.control.field.triangle_twists import triangle_twist_squares
from poil_drake.control.field.turn_solve import twist_squares, twist_turn
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.centred_sums import CentredSums, centred_sums
from poil_drake.geometry.triples import choose_triples


@dataclass(frozen=True, kw_only=True)
class RansacConfig:
    """Parameters of the RANSAC for outlier velocities.

    Attributes:
        inlier_threshold: Largest residual of an inlier [m/s]. With eta = 3 / s a tracking
            error of 5 mm gives 0.015 m/s; a tracker's noise of 1 mm gives 0.003 m/s.
    """

    inlier_threshold: float = 0.015


class RobustTwist(NamedTuple):
    """A twist fitted to the inliers of a set of points.

    Attributes:
        omega: (3,) angular velocity [rad/s].
        v: (3,) velocity of the centroid [m/s].
        centroid: (3,) weighted centroid of the inliers [m].
        inliers: (N,) bool.
        spread: Root mean square distance of the inliers from their best-fitting line [m]. If it is
            zero, the rotation about that line is not determined.
    """

    omega: np.ndarray
    v: np.ndarray
    centroid: np.ndarray
    inliers: np.ndarray
    spread: float

    @classmethod
    def of(
        cls,
        sums: CentredSums,
        omega: tuple[float, float, float],
        inliers: np.ndarray,
        spread: float,
    ) -> "RobustTwist":
        """Returns the twist with the mean velocity, and makes its arrays read-only.

        Args:
            sums: Sums of the points and their velocities; more may follow.
            omega: Angular velocity [rad/s].
            inliers: (N,) bool.
            spread: See `RobustTwist` [m].
        """
        turn = np.array(omega)
        turn.setflags(write=False)
        inliers.setflags(write=False)
        return cls(turn, sums.mean[3:6], sums.mean[:3], inliers, spread)


def fit_twist(
    points: np.ndarray,
    velocities: np.ndarray,
    weights: np.ndarray | None = None,
    inliers: np.ndarray | None = None,
    min_rotation_spread: float = 0.0,
) -> tuple[RobustTwist, np.ndarray]:
    """Returns the twist that best fits the velocities of the inliers, and all squared residuals.

    Minimises sum_i w_i |v + omega x (x_i - c) - v_i|^2 about the weighted centroid c (POIL eq. 3),
    where the normal equations decouple: v is the mean velocity, and A omega = sum_i w_i r_i x v_i
    with r_i = x_i - c and A = sum_i w_i (|r_i|^2 I - r_i r_i^T). If the points do not determine
    omega (fewer than 3, or collinear), the smallest minimiser is returned.

    About a principal axis from which the points are a root mean square distance s away, noise in
    the velocities is divided by s. Below s0 = `min_rotation_spread` the turn is scaled by
    (s / s0)^2, so that noise is divided by s0 at least, and the turn fades out continuously as the
    points approach the axis. D still falls, since each axis contributes to its rate separately.

    Args:
        points: (N, 3) positions [m].
        velocities: (N, 3) their velocities [m/s].
        weights: (N,) non-negative, not all zero; None for all equal.
        inliers: (N,) bool; None for all points.
        min_rotation_spread: s0 [m]; 0 for plain least squares.

    Returns:
        fit: See `RobustTwist`.
        squares: (N,) squared residuals [m^2/s^2].
    """
    counted = np.ones(len(points)) if weights is None else weights
    if inliers is None:
        inliers = everyone(len(points))
    else:
        counted = counted * inliers
    sums = centred_sums((points, velocities), counted)
    omega, spread = twist_turn(sums, min_rotation_spread)
    fit = RobustTwist.of(sums, omega, inliers, spread)
    return fit, twist_squares(sums, omega)


@lru_cache(maxsize=32)
def everyone(count: int) -> np.ndarray:
    """Returns the mask (N,) bool of all points, read-only."""
    mask = np.ones(count, dtype=bool)
    mask.flags.writeable = False
    return mask


def fit_twist_ransac(
    points: np.ndarray,
    velocities: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    config: RansacConfig,
    min_rotation_spread: float = 0.0,
) -> RobustTwist:
    """Returns the twist that best fits the velocities of points, without outliers.

    If plain least squares leaves no residual above the threshold, its twist is returned. Otherwise
    each set of three points proposes a twist; the one with the least truncated cost (MSAC, Torr and
    Zisserman 2000) determines the inliers, to which the returned twist is fitted.

    The velocities of POIL eq. 2 agree with one twist only near the reference. At an angle t from it
    they contain a contraction of (1 - cos t) eta |r|, which looks like outliers once it exceeds the
    threshold. `rigid_inliers` has no such limit.

    Args:
        points: (N, 3) positions [m].
        velocities: (N, 3) their velocities [m/s].
        weights: (N,) positive; None for all equal.
        config: The threshold.
        min_rotation_spread: See `fit_twist`.
    """
    w = np.ones(len(points)) if weights is None else weights
    fit, squares = fit_twist(points, velocities, w, min_rotation_spread=min_rotation_spread)
    limit = config.inlier_threshold**2
    if len(points) < 4 or squares.max() <= limit:
        return fit
    triples = choose_triples(points)
    if len(triples) == 0:
        return fit
    squares = triangle_twist_squares(points, velocities, triples)
    best = int((w @ np.minimum(squares, limit)).argmin())
    inliers = squares[:, best] <= limit
    inliers[triples[best]] = True
    # One more round: the fit to all inliers is better than the three points' and may add others.
    fit, squares = fit_twist(points, velocities, w, inliers, min_rotation_spread)
    grown = squares <= limit
    if np.count_nonzero(grown) > np.count_nonzero(inliers):
        fit, _ = fit_twist(points, velocities, w, grown, min_rotation_spread)
    return fit


def shift_twist(V_WP: np.ndarray, p_PQ: np.ndarray) -> np.ndarray:
    """Returns the spatial velocity (..., 6) of a body at Q from that at P.

    Args:
        V_WP: (..., 6), (omega [rad/s], v [m/s]), world.
        p_PQ: (..., 3) from P to Q [m], world.
    """
    V_WQ = np.array(V_WP, dtype=float)
    p_PQ = np.asarray(p_PQ, dtype=float)
    if V_WQ.ndim == p_PQ.ndim == 1:
        (wx, wy, wz), (x, y, z) = V_WQ[:3].tolist(), p_PQ.tolist()
        # np.cross takes longer than the rest of shifting and scaling in a control tick.
        V_WQ[3:] += (wy * z - wz * y, wz * x - wx * z, wx * y - wy * x)
        return V_WQ
    V_WQ[..., 3:] += np.cross(V_WQ[..., :3], p_PQ)
    return V_WQ


def scale_twist(V: np.ndarray, max_angular_speed: float, max_linear_speed: float) -> np.ndarray:
    """Returns spatial velocities, each scaled by one factor so that it respects both limits.

    The direction and so the path are kept: it is a scaling of time, under which D of POIL eq. 4
    still falls. Limits on single axes would bend the path. A velocity that is not finite becomes
    zero.

    Args:
        V: (..., 6), (omega [rad/s], v [m/s]).
        max_angular_speed: Largest |omega| [rad/s], positive.
        max_linear_speed: Largest |v| [m/s], positive.
    """
    if not (max_angular_speed > 0.0 and max_linear_speed > 0.0):
        raise InvalidValueError(
            f"The speed limits are {max_angular_speed} rad/s and {max_linear_speed} m/s.",
            remedy="Both must be positive.",
        )
    V = np.asarray(V, dtype=float)
    if V.ndim > 1:
        finite = np.where(np.isfinite(V).all(axis=-1, keepdims=True), V, 0.0)
        speeds = np.linalg.norm(finite.reshape(*V.shape[:-1], 2, 3), axis=-1)
        excesses = speeds / [max_angular_speed, max_linear_speed]
        return finite / np.maximum(1.0, excesses.max(axis=-1, keepdims=True))
    wx, wy, wz, vx, vy, vz = numbers = V.tolist()
    if not all(map(math.isfinite, numbers)):
        return np.zeros(6)
    excess = max(
        math.sqrt(wx * wx + wy * wy + wz * wz) / max_angular_speed,
        math.sqrt(vx * vx + vy * vy + vz * vz) / max_linear_speed,
    )
    return V / max(1.0, excess)
