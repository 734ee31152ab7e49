"""The closest configuration of a reference to the points (POIL eq. 1)."""

import math

import numpy as np

from poil_drake.control.reference.point_trajectory import PointTrajectory


def closest_configuration(
    points: np.ndarray,
    reference: PointTrajectory,
    weights: np.ndarray | None = None,
    *,
    interpolate: bool,
    window: tuple[float, float] | None = None,
    escape_ratio: float = 0.0,
    previous_tau: float | None = None,
) -> tuple[int, float]:
    """Returns the closest configuration: a sample, and the fraction of the way to the next.

    Args:
        points: (N, 3) [m], finite.
        reference: The reference of the same N points.
        weights: (N,) non-negative, None for all one. Points of weight zero are ignored.
        interpolate: Whether to search between samples too; otherwise the fraction is 0.
        window: Search range (backward, forward) around the last tick's closest configuration [s];
            None searches the whole reference.
        escape_ratio: With a window, the closest of all samples is used if its squared distance is
            below this fraction of the closest one's within the window.
        previous_tau: Time of the last tick's closest configuration [s]. None or NaN for no window.
    """
    costs, tolerance = reference.features.relative_costs(points, weights)
    positions = reference.positions
    index = _last_minimum(costs, tolerance, points, positions, weights)
    if window is not None and previous_tau is not None and not math.isnan(previous_tau):
        begin, end = window_samples(reference.times, previous_tau, window)
        nearby = begin + _last_minimum(
            costs[begin:end], tolerance, points, positions[begin:end], weights
        )
        anywhere_square, nearby_square = squared_distances(
            points, positions[[index, nearby]], weights
        ).tolist()
        if not anywhere_square < escape_ratio * nearby_square:
            index = nearby
    return between_samples(points, reference, index, weights) if interpolate else (index, 0.0)


def squared_distances(
    points: np.ndarray, positions: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Returns sum_i w_i |x_i - x*_i(tau)|^2 (T,) [m^2] at every sample.

    Equal samples get equal sums.

    Args:
        points: (N, 3) [m].
        positions: (T, N, 3) the reference's [m].
        weights: (N,), None for all one.
    """
    differences = (positions - points).reshape(len(positions), -1)
    if weights is None:
        return np.einsum("tk,tk->t", differences, differences)
    # A matrix product rounds rows differently, so equal samples would get different sums.
    return np.einsum("tk,k->t", np.square(differences, out=differences), np.repeat(weights, 3))


def window_samples(
    times: np.ndarray, previous_tau: float, window: tuple[float, float]
) -> tuple[int, int]:
    """Returns the first sample of the progress window and the one after its last.

    Args:
        times: (T,) of the samples [s].
        previous_tau: Time of the last tick's closest configuration [s].
        window: Search range (backward, forward) around it [s].
    """
    backward, forward = window
    begin = int(times.searchsorted(previous_tau - backward))
    end = int(times.searchsorted(previous_tau + forward, side="right"))
    # A window narrower than a sample still holds the samples on both sides of the last tick.
    last = max(int(times.searchsorted(previous_tau, side="right")) - 1, 0)
    return min(begin, last), max(end, min(last + 2, times.size))


def between_samples(
    points: np.ndarray, reference: PointTrajectory, index: int, weights: np.ndarray | None = None
) -> tuple[int, float]:
    """Returns the closest configuration on the two segments that meet at a sample.

    With x* = a + s (b - a) the squared distance is quadratic in s, and least at
    s = sum_i w_i (x_i - a_i).(b_i - a_i) / sum_i w_i |b_i - a_i|^2.

    Args:
        points: (N, 3) [m].
        reference: The reference of the same N points.
        index: The closest sample.
        weights: (N,), None for all one.

    Returns:
        segment: The sample at which its segment begins.
        fraction: Fraction of the segment, in [0, 1); 0 at the last sample.
    """
    offset = (points - reference.positions[index]).ravel()
    first, end = max(index - 1, 0), index + 1
    features = reference.features
    steps = features.steps[first:end]
    if weights is None:
        lengths = features.squared_steps[first:end]
    else:
        offset *= (repeated := np.repeat(weights, 3))
        lengths = (steps * steps).dot(repeated)
    alongs = steps.dot(offset).tolist()
    best, segment, fraction = 0.0, index, 0.0
    for k, direction in ((index, 1.0), (index - 1, -1.0)):  # Segment k begins at sample k.
        if not 0 <= k - first < len(alongs):
            continue
        along = direction * alongs[k - first]
        if along <= 0.0:
            continue
        length = float(lengths[k - first])
        s = min(along / length, 1.0)
        gain = s * (2.0 * along - s * length)
        if gain > best:
            best = gain
            segment, fraction = k, s if k == index else 1.0 - s
    return (segment + 1, 0.0) if fraction >= 1.0 else (segment, fraction)


def _last_minimum(
    costs: np.ndarray,
    tolerance: float,
    points: np.ndarray,
    positions: np.ndarray,
    weights: np.ndarray | None,
) -> int:
    """Returns the closest sample, the last of equal ones so that a pause is passed.

    Samples whose costs agree within the tolerance are compared by `squared_distances`.

    Args:
        costs: (T,) see `SampleFeatures.relative_costs`.
        tolerance: Largest difference of equal costs by rounding.
        points: (N, 3) [m].
        positions: (T, N, 3) the reference's [m].
        weights: (N,), None for all one.
    """
    index = int(costs.argmin())
    close = costs <= costs.item(index) + tolerance
    count = np.count_nonzero(close)
    if count == 1:
        return index
    # If the costs overflow, no sample is close.
    candidates = close.nonzero()[0] if count else np.arange(len(costs))
    squares = squared_distances(points, positions[candidates], weights)
    return int(candidates[::-1][squares[::-1].argmin()])
