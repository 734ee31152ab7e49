"""Point-set BCSDM at many states at once, for studies and rollouts."""

from dataclasses import dataclass

import numpy as np

from poil_drake.control.field.batched_closest_configuration import closest_configurations
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import transform_points, vee

_WELL_CONDITIONED = 1e-2
"""Least ratio of the smallest to the largest eigenvalue of A for the batched least squares."""

_STATUS_BY_AT_GOAL = np.array([BcsdmStatus.OK, BcsdmStatus.GOAL], dtype=object)


@dataclass(frozen=True, eq=False)
class BatchedField:
    """The field at B states; row b is `point_set_bcsdm` of state b.

    Attributes:
        omega: (B, 3) angular velocities of the object [rad/s, world]; zero when lost.
        v: (B, 3) velocities of the centroid [m/s, world]; zero when lost.
        centroid: (B, 3) weighted centroids [m, world]; NaN when lost.
        tau: (B,) times of the closest configurations [s]; NaN when lost.
        index: (B,) their nearest samples; -1 when lost.
        potential: (B,) D of POIL eq. 4 [m^2]; NaN when lost.
        mean_error: (B,) mean distances from the closest configurations [m]; NaN when lost.
        goal_error: (B,) mean distances from the reference's end [m]; NaN when lost.
        inliers: (B, N) bool, which points the twists were fitted to.
        status: (B,) of `BcsdmStatus`, so that `field.status == BcsdmStatus.GOAL` is (B,) bool.
    """

    omega: np.ndarray
    v: np.ndarray
    centroid: np.ndarray
    tau: np.ndarray
    index: np.ndarray
    potential: np.ndarray
    mean_error: np.ndarray
    goal_error: np.ndarray
    inliers: np.ndarray
    status: np.ndarray

    @property
    def twist(self) -> np.ndarray:
        """(B, 6) (omega [rad/s], v [m/s]) of the objects at `centroid`, world."""
        return np.concatenate([self.omega, self.v], axis=1)


def batched_field(
    points: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    confidence: np.ndarray | None = None,
    previous_tau: np.ndarray | None = None,
) -> BatchedField:
    """Returns `point_set_bcsdm` of B states, up to rounding.

    States with all points observed, in general position and without outliers are computed
    together, the others one by one.

    Args:
        points: (B, N, 3) positions [m, world]; NaN where not observed.
        reference: The reference of the same N points.
        config: Parameters of the field.
        confidence: (B, N) weights in [0, 1]; 0 excludes a point, None weights all equally.
        previous_tau: (B,) the last tick's tau [s], for the progress window; NaN for a state
            without one, None if no state has one.

    Raises:
        InvalidValueError: if the number of points differs from the reference's, or there is not
            one confidence for each point and one previous tau for each state.
    """
    B, N = points.shape[0], reference.positions.shape[1]
    weights = np.ones((B, N)) if confidence is None else confidence
    taus = np.full(B, np.nan) if previous_tau is None else previous_tau
    if (points.shape, weights.shape, taus.shape) != ((B, N, 3), (B, N), (B,)):
        raise InvalidValueError(
            f"batched_field() got points of shape {points.shape}, weights of shape "
            f"{weights.shape} and times of shape {taus.shape}.",
            remedy=f"Pass ({B}, {N}, 3), ({B}, {N}) and ({B},): the reference has {N} points.",
        )
    field = BatchedField(
        omega=np.zeros((B, 3)),
        v=np.zeros((B, 3)),
        centroid=np.full((B, 3), np.nan),
        tau=np.full(B, np.nan),
        index=np.full(B, -1),
        potential=np.full(B, np.nan),
        mean_error=np.full(B, np.nan),
        goal_error=np.full(B, np.nan),
        inliers=np.zeros((B, N), dtype=bool),
        status=np.full(B, BcsdmStatus.LOST, dtype=object),
    )
    observed = (weights > 0.0) & (weights < np.inf) & np.isfinite(points.sum(axis=2))
    together = observed.all(axis=1) & (N >= 3)
    rows = np.flatnonzero(together)
    if len(rows) > 0:
        together[rows] = _fill(
            field, rows, points[rows], reference, config, weights[rows], taus[rows]
        )
    for b in np.flatnonzero(~together):
        output = point_set_bcsdm(points[b], reference, config, weights[b], taus[b])
        for name, values in vars(field).items():
            values[b] = getattr(output, name)
    for values in vars(field).values():
        values.flags.writeable = False
    return field


def _fill(
    field: BatchedField,
    rows: np.ndarray,
    x: np.ndarray,
    reference: PointTrajectory,
    config: BcsdmConfig,
    w: np.ndarray,
    previous_tau: np.ndarray,
) -> np.ndarray:
    """Fills in the field of K states and returns for which of them (K,) bool it is valid.

    Args:
        field: The output.
        rows: (K,) rows of the states in it.
        x: (K, N, 3) finite points [m].
        reference: The reference.
        config: Parameters of the field.
        w: (K, N) positive weights.
        previous_tau: (K,) [s]; NaN for a state without one.
    """
    segment, fraction = closest_configurations(
        x,
        reference,
        w,
        interpolate=config.interpolate,
        window=config.progress_window,
        escape_ratio=config.window_escape_ratio,
        previous_tau=previous_tau,
    )
    errors = _interpolate(reference.positions, segment, fraction) - x
    velocities = _interpolate(reference.velocities, segment, fraction) + config.eta * errors
    shares = w / w.sum(axis=1, keepdims=True)
    omega, v, centroid, squares, valid = _fit_twists(
        x, velocities, shares, max(config.min_spread, config.min_rotation_spread)
    )
    tau = _interpolate(reference.times, segment, fraction)
    goal_error = np.einsum("kn,kn->k", shares, _lengths(reference.positions[-1] - x))
    distances = _lengths(errors)
    at_goal = goal_error < config.goal_tolerance
    at_goal &= tau >= reference.times[-1] - config.goal_window
    field.omega[rows], field.v[rows], field.centroid[rows] = omega, v, centroid
    field.tau[rows], field.index[rows] = tau, segment + np.rint(fraction).astype(int)
    field.potential[rows] = 0.5 * np.einsum("kn,kn->k", w, distances**2)
    field.mean_error[rows] = np.einsum("kn,kn->k", shares, distances)
    field.goal_error[rows], field.inliers[rows] = goal_error, True
    field.status[rows] = _STATUS_BY_AT_GOAL[at_goal.astype(int)]
    return valid & ~_with_outliers(x, x + errors, w, squares.max(axis=1), config)


def _fit_twists(
    points: np.ndarray, velocities: np.ndarray, shares: np.ndarray, min_spread: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns omega, v, centroid (K, 3), squared residuals (K, N), and where they are valid (K,).

    The fit is `fit_twist` of all points. It is valid where the points determine the
    rotation by a margin that rounding cannot change.
    """
    centroid = np.einsum("kn,kni->ki", shares, points)
    v = np.einsum("kn,kni->ki", shares, velocities)
    arms = points - centroid[:, None]
    weighted_arms = (arms * shares[:, :, None]).swapaxes(1, 2)
    products = weighted_arms @ velocities
    moments = vee(products.swapaxes(1, 2) - products)
    eigenvalues, axes = np.linalg.eigh(weighted_arms @ arms)
    gains = eigenvalues.sum(axis=1, keepdims=True) - eigenvalues
    # The smallest gain is the squared spread about the best-fitting line.
    valid = (gains[:, 2] >= _WELL_CONDITIONED * gains[:, 0]) & (gains[:, 2] >= 1.01 * min_spread**2)
    gains[~valid] = 1.0
    turns = np.einsum("kij,ki->kj", axes, moments) / gains
    omega = np.einsum("kij,kj->ki", axes, turns)
    residuals = (v[:, None] - velocities) + np.cross(omega[:, None], arms)
    return omega, v, centroid, np.einsum("kni,kni->kn", residuals, residuals), valid


def _with_outliers(
    source: np.ndarray,
    target: np.ndarray,
    weights: np.ndarray,
    largest: np.ndarray,
    config: BcsdmConfig,
) -> np.ndarray:
    """Returns which of K states (K,) bool may have outliers.

    Args:
        source: (K, N, 3) points [m].
        target: (K, N, 3) the closest configurations [m].
        weights: (K, N) positive.
        largest: (K,) largest squared residual of the twist [m^2/s^2].
        config: Parameters of the field.
    """
    if config.outlier_test == "none" or source.shape[1] < 4:
        return np.zeros(len(source), dtype=bool)
    if config.outlier_test == "velocity":
        return largest > config.ransac.inlier_threshold**2
    limit = config.rigidity.inlier_distance
    suspicious = largest > (config.eta * limit) ** 2
    if suspicious.any():
        x, y, w = source[suspicious], target[suspicious], weights[suspicious]
        distances = _lengths(transform_points(kabsch(x, y, w), x) - y)
        suspicious[suspicious] = distances.max(axis=1) > limit
    return suspicious


def _interpolate(values: np.ndarray, segment: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    start = values[segment]
    end = values[np.minimum(segment + 1, len(values) - 1)]
    return start + fraction.reshape(-1, *[1] * (values.ndim - 1)) * (end - start)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
