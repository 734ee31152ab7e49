"""The closest configurations of a reference to many states of its points (POIL eq. 1)."""

import numpy as np

from poil_drake.control.reference.point_trajectory import PointTrajectory

_SINGLE_THREAD_PRODUCTS = 2**18
"""Up to this many multiplications OpenBLAS uses one thread.

In studies that run one process per core, OpenBLAS threads would compete for the cores, which takes
longer than the product itself.
"""


def closest_configurations(
    points: np.ndarray,
    reference: PointTrajectory,
    weights: np.ndarray,
    *,
    interpolate: bool,
    window: tuple[float, float] | None = None,
    escape_ratio: float = 0.0,
    previous_tau: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns `closest_configuration` of B states: segments and fractions, (B,) each.

    Args:
        points: (B, N, 3) [m], finite; B >= 1.
        reference: The reference of the same N points.
        weights: (B, N).
        interpolate: See `closest_configuration`.
        window: See `closest_configuration`.
        escape_ratio: See `closest_configuration`.
        previous_tau: (B,) [s]; NaN for a state without one.
    """
    costs, tolerances = _relative_costs(points, reference, weights)
    index, squares = _last_minima(costs, tolerances, points, reference.positions, weights)
    if window is not None and previous_tau is not None:
        begin, end = _windows(reference.times, previous_tau, window)
        sample = np.arange(reference.times.size)
        outside = (sample < begin[:, None]) | (sample >= end[:, None])
        costs[outside] = np.inf
        nearby, nearby_squares = _last_minima(
            costs, tolerances, points, reference.positions, weights
        )
        index = np.where(squares < escape_ratio * nearby_squares, index, nearby)
    if not interpolate:
        return index, np.zeros(len(points))
    return _between_samples(points, reference.positions, index, weights)


def _relative_costs(
    points: np.ndarray, reference: PointTrajectory, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns `SampleFeatures.relative_costs` of B states: (B, T) [m^2], and tolerances (B,)."""
    features = reference.features
    B = len(points)
    weighted = points * weights[:, :, None]
    factors = np.concatenate([-weighted.reshape(B, -1), weights], axis=1)
    costs = np.empty((B, reference.times.size))
    stride = max(_SINGLE_THREAD_PRODUCTS // features.stacked.size, 1)
    for begin in range(0, B, stride):
        rows = slice(begin, begin + stride)
        np.matmul(factors[rows], features.stacked, out=costs[rows])
    sizes = np.einsum("bni,bni->b", weighted, points) + weights @ features.sizes
    return costs, features.tolerance_factor * sizes


def _last_minima(
    costs: np.ndarray,
    tolerances: np.ndarray,
    points: np.ndarray,
    positions: np.ndarray,
    weights: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the closest sample of each state and its squared distance, (B,) each.

    Samples whose costs agree within the tolerance are compared by `squared_distances`, and the last
    of equal samples is taken, so that the choice is the same as for a single state.
    """
    limits = costs.min(axis=1) + tolerances
    states, samples = np.nonzero(costs <= limits[:, None])
    differences = (positions[samples] - points[states]).reshape(len(samples), -1)
    squares = np.einsum(
        "tk,tk->t", np.square(differences, out=differences), np.repeat(weights[states], 3, axis=1)
    )
    starts = np.searchsorted(states, np.arange(len(points)))
    smallest = np.minimum.reduceat(squares, starts)
    last = np.maximum.reduceat(np.where(squares == smallest[states], samples, -1), starts)
    return last, smallest


def _windows(
    times: np.ndarray, previous_tau: np.ndarray, window: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the first sample of each state's window and the one after its last, (B,) each."""
    backward, forward = window
    last = np.maximum(np.searchsorted(times, previous_tau, side="right") - 1, 0)
    begin = np.minimum(np.searchsorted(times, previous_tau - backward), last)
    end = np.searchsorted(times, previous_tau + forward, side="right")
    end = np.maximum(end, np.minimum(last + 2, times.size))
    unknown = np.isnan(previous_tau)
    return np.where(unknown, 0, begin), np.where(unknown, times.size, end)


def _between_samples(
    points: np.ndarray, positions: np.ndarray, index: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns `between_samples` of B states: segments and fractions, (B,) each."""
    last = len(positions) - 1
    here = positions[index]
    offsets = (points - here) * weights[:, :, None]
    best, fraction, segment = np.zeros(len(points)), np.zeros(len(points)), index
    for neighbour in (index + 1, index - 1):
        steps = positions[np.clip(neighbour, 0, last)] - here
        along = np.einsum("bni,bni->b", offsets, steps)
        length = np.einsum("bni,bni,bn->b", steps, steps, weights)
        ahead = along > 0.0
        s = np.minimum(np.divide(along, length, out=np.zeros_like(along), where=ahead), 1.0)
        gain = s * (2.0 * along - s * length)
        better = gain > best
        best = np.where(better, gain, best)
        forward = neighbour > index
        fraction = np.where(better, np.where(forward, s, 1.0 - s), fraction)
        segment = np.where(better, np.where(forward, index, neighbour), segment)
    whole = fraction >= 1.0
    return np.where(whole, segment + 1, segment), np.where(whole, 0.0, fraction)
