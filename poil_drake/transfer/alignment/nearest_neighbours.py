"""Nearest neighbours between many placements of one cloud and another cloud."""

from typing import NamedTuple

import numpy as np


class NearestNeighbours(NamedTuple):
    """Nearest neighbours in both directions.

    Attributes:
        target_of_source: (K, n) index of the target point nearest to each source point.
        source_squares: (K, n) squared distance from each source point to that target point.
        source_of_target: (K, m) index of the source point nearest to each target point.
        target_squares: (K, m) squared distance from each target point to that source point.
    """

    target_of_source: np.ndarray
    source_squares: np.ndarray
    source_of_target: np.ndarray
    target_squares: np.ndarray


def nearest_both_ways(sources: np.ndarray, target: np.ndarray) -> NearestNeighbours:
    """Returns the nearest neighbours in both directions, by brute force.

    |a - b|^2 is least where a . b - |b|^2 / 2 is greatest, so matrix products do the search.
    Neighbours are found in single precision. Their distances are computed in double precision.

    Args:
        sources: (K, n, d) K placements of one cloud.
        target: (m, d) the other cloud, of about unit size.
    """
    a, b = sources.astype(np.float32), target.astype(np.float32)
    forward = _with(a, 1.0) @ _with(b, -0.5 * np.sum(b * b, axis=-1)).T
    j = np.argmax(forward, axis=2)
    backward = _with(b, 1.0) @ np.swapaxes(_with(a, -0.5 * np.sum(a * a, axis=-1)), 1, 2)
    i = np.argmax(backward, axis=2)
    nearest_source = np.take_along_axis(sources, i[..., None], axis=1)
    return NearestNeighbours(
        j,
        np.sum((sources - target[j]) ** 2, axis=-1),
        i,
        np.sum((nearest_source - target) ** 2, axis=-1),
    )


def _with(points: np.ndarray, last: np.ndarray | float) -> np.ndarray:
    """Returns the points with `last` appended as one more coordinate, in single precision."""
    column = np.broadcast_to(np.float32(last), points.shape[:-1])[..., None]
    return np.concatenate([points, column.astype(np.float32)], axis=-1)
