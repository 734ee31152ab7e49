"""The configuration of a reference that is closest to the points (POIL eq. 1)."""

import math

import numpy as np


def closest_configuration(
    points: np.ndarray,
    positions: np.ndarray,
    times: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    interpolate: bool,
    window: tuple[float, float] | None = None,
    escape_ratio: float = 0.0,
    previous_tau: float | None = None,
) -> tuple[int, float]:
    """Returns the place of a reference closest to the points: a sample and a fraction to the next.

    Args:
        points: (N, 3) [m].
        positions: (T, N, 3) the reference's [m].
        times: (T,) of the samples [s].
        weights: (N,), None for all one.
        interpolate: Whether to look between the samples too; the fraction is 0 otherwise.
        window: See `nearest_sample_in_window`.
        escape_ratio: See `nearest_sample_in_window`.
        previous_tau: See `nearest_sample_in_window`.
    """
    index = nearest_sample_in_window(
        squared_distances(points, positions, weights),
        times,
        previous_tau=previous_tau,
        window=window,
        escape_ratio=escape_ratio,
    )
    return between_samples(points, positions, index, weights) if interpolate else (index, 0.0)


def squared_distances(
    points: np.ndarray, positions: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Returns sum_i w_i |x_i - x*_i(tau)|^2 (T,) [m^2] at every sample.

    Args:
        points: (N, 3) [m].
        positions: (T, N, 3) the reference's [m].
        weights: (N,), None for all one.
    """
    differences = (positions - points).reshape(len(positions), -1)
    if weights is None:
        return np.einsum("tk,tk->t", differences, differences)
    # A matrix product rounds some rows otherwise than others, so that equal samples would differ.
    return np.einsum("tk,k->t", np.square(differences, out=differences), np.repeat(weights, 3))


def nearest_sample(
    points: np.ndarray, positions: np.ndarray, weights: np.ndarray | None = None
) -> int:
    """Returns the index of the reference's sample closest to the points (POIL eq. 1).

    Among equals it is the last, so that a reference that stands still is passed.

    Args:
        points: (N, 3) [m].
        positions: (T, N, 3) the reference's [m].
        weights: (N,), None for all one.
    """
    return _last_minimum(squared_distances(points, positions, weights))


def nearest_sample_in_window(
    squares: np.ndarray,
    times: np.ndarray,
    *,
    previous_tau: float | None,
    window: tuple[float, float] | None,
    escape_ratio: float,
) -> int:
    """Returns the index of the closest sample near the one of the last tick.

    Args:
        squares: (T,) squared distances to every sample [m^2].
        times: (T,) of the samples [s].
        previous_tau: Time of the last tick's closest configuration [s]. None or NaN: no window.
        window: How far to look (backward, forward) of it [s]; None looks everywhere.
        escape_ratio: The closest of all samples wins where its squared distance is below this part
            of the one within the window.
    """
    anywhere = _last_minimum(squares)
    if window is None or previous_tau is None or math.isnan(previous_tau):
        return anywhere
    backward, forward = window
    begin = int(np.searchsorted(times, previous_tau - backward))
    end = int(np.searchsorted(times, previous_tau + forward, side="right"))
    # A window narrower than a sample still holds the samples on both sides of the last tick.
    last = int(np.searchsorted(times, previous_tau, side="right")) - 1
    begin = min(begin, max(last, 0))
    end = max(end, min(max(last, 0) + 2, len(times)))
    nearby = begin + _last_minimum(squares[begin:end])
    return anywhere if squares[anywhere] < escape_ratio * squares[nearby] else nearby


def between_samples(
    points: np.ndarray, positions: np.ndarray, index: int, weights: np.ndarray | None = None
) -> tuple[int, float]:
    """Returns the place closest to the points on the two segments that meet at a sample.

    With x* = a + s (b - a) the squared distance is quadratic in s, and least at
    s = sum_i w_i (x_i - a_i).(b_i - a_i) / sum_i w_i |b_i - a_i|^2.

    Args:
        points: (N, 3) [m].
        positions: (T, N, 3) the reference's [m].
        index: The closest sample.
        weights: (N,), None for all one.

    Returns:
        segment: The sample that the place comes after.
        fraction: Part of the way to the next one, in [0, 1); 0 at the last sample.
    """
    best, segment, fraction = 0.0, index, 0.0
    offset = points - positions[index]
    if weights is not None:
        offset = offset * weights[:, None]
    for neighbour in (index + 1, index - 1):
        if not 0 <= neighbour < len(positions):
            continue
        step = positions[neighbour] - positions[index]
        along = float(np.vdot(offset, step))
        if along <= 0.0:
            continue
        weighted_step = step if weights is None else step * weights[:, None]
        length = float(np.vdot(weighted_step, step))
        s = min(along / length, 1.0)
        gain = s * (2.0 * along - s * length)
        if gain > best:
            best = gain
            segment, fraction = (index, s) if neighbour > index else (neighbour, 1.0 - s)
    return (segment + 1, 0.0) if fraction >= 1.0 else (segment, fraction)


def _last_minimum(squares: np.ndarray) -> int:
    return len(squares) - 1 - int(squares[::-1].argmin())
