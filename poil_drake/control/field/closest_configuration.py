"""The closest configuration of a reference to the points (POIL eq. 1)."""

import numpy as np

from poil_drake.control.reference.point_trajectory import PointTrajectory

_ROUNDING = 1e-14
"""Costs that differ by less than this fraction of the reference's squared distance from the world's
origin count as equal."""


def closest_configuration(
    points: np.ndarray,
    reference: PointTrajectory,
    shares: np.ndarray,
    *,
    interpolate: bool,
    window: tuple[float, float] | None = None,
    escape_ratio: float = 0.0,
    previous_tau: np.ndarray | float | None = None,
) -> np.ndarray:
    """Returns the index (...) of the closest configuration; 2.5 is between samples 2 and 3.

    If several samples are equally close, the last one is chosen, so that pauses are skipped.

    Args:
        points: (..., N, 3) [m], finite.
        reference: The reference of the same N points.
        shares: (..., N) weights, which add up to 1; points of weight zero are ignored.
        interpolate: Whether to search between samples, too.
        window: Search range (backward, forward) around the last tick's closest configuration [s];
            None searches the whole reference.
        escape_ratio: The window is ignored if the smallest squared distance of all samples is below
            this fraction of the smallest in the window.
        previous_tau: (...) time of the last tick's closest configuration [s]; NaN for no window.
    """
    # |x - x*|^2 / 2 without |x|^2 / 2, which is the same for all samples.
    weighted = _flat(shares[..., None] * points)
    costs = np.concatenate([weighted, shares], axis=-1) @ reference.cost_terms
    rounding = _ROUNDING * reference.largest_square
    index = _last_minimum(costs, rounding)
    if window is not None and previous_tau is not None:
        outside = _outside(reference.times, np.asarray(previous_tau), window)
        nearby = _last_minimum(np.where(outside, np.inf, costs), rounding)
        anywhere_square, nearby_square = (
            np.vecdot(shares, np.square(reference.positions[i] - points).sum(axis=-1))
            for i in (index, nearby)
        )
        index = np.where(anywhere_square < escape_ratio * nearby_square, index, nearby)
    if not interpolate:
        return index.astype(float)
    # The closest configurations on the two segments beside the closest sample.
    steps = reference.steps[index]
    offset = _flat(shares[..., None] * (points - reference.positions[index]))
    along = np.vecdot(steps, offset[..., None, :])
    length = np.vecdot(reference.squared_steps[index], shares[..., None, :])
    fraction = np.minimum(np.maximum(along / np.maximum(length, 1e-300), 0.0), 1.0)
    gain = fraction * (2.0 * along - fraction * length)
    forward = gain[..., 0] >= gain[..., 1]
    return index + forward * fraction[..., 0] - ~forward * fraction[..., 1]


def _flat(vectors: np.ndarray) -> np.ndarray:
    return vectors.reshape((*vectors.shape[:-2], 3 * vectors.shape[-2]))


def _last_minimum(costs: np.ndarray, rounding: float) -> np.ndarray:
    """Returns the index (...) of the last of the smallest costs (..., T), up to rounding."""
    smallest = costs <= costs.min(axis=-1, keepdims=True) + rounding
    return costs.shape[-1] - 1 - smallest[..., ::-1].argmax(axis=-1)


def _outside(
    times: np.ndarray, previous_tau: np.ndarray, window: tuple[float, float]
) -> np.ndarray:
    """Returns which samples are outside of the progress window: (..., T) bool.

    Even the narrowest window contains the samples on both sides of `previous_tau`.
    """
    backward, forward = window
    tau = previous_tau[..., None]
    after = np.arange(times.size) - np.maximum(np.searchsorted(times, tau, side="right") - 1, 0)
    return ((times < tau - backward) | (times > tau + forward)) & (after != 0) & (after != 1)
