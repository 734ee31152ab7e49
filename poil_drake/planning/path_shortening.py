"""Checks straight edges between configurations, shortens paths and rounds their corners."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

IsFree = Callable[[np.ndarray], np.ndarray]
"""Returns which configurations (B, D) are free: (B,) bool."""


@dataclass(frozen=True)
class EdgeChecker:
    """Checks straight edges between configurations.

    Attributes:
        are_free: The collision check of configurations.
        resolution: Distance between the checked configurations, in the configurations' unit.
    """

    are_free: IsFree
    resolution: float

    def samples(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Returns configurations (K, D), K >= 2, from one end (D,) of an edge to the other."""
        count = max(int(np.ceil(np.linalg.norm(last - first) / self.resolution)), 1)
        return first + np.linspace(0.0, 1.0, count + 1)[:, None] * (last - first)

    def is_free(self, first: np.ndarray, last: np.ndarray) -> bool:
        """Returns whether the straight edge between two configurations (D,) is free.

        Its middle is checked first, because most collisions are there.
        """
        samples = self.samples(first, last)
        middle = len(samples) // 2
        return bool(self.are_free(samples[middle : middle + 1])[0] and self.are_free(samples).all())


def shorten_path(
    corners: np.ndarray, edges: EdgeChecker, attempts: int, rng: np.random.Generator
) -> np.ndarray:
    """Shortens a path by joining random pairs of points on it, and returns its corners (K, D).

    Args:
        corners: (K, D) corners of a free path.
        edges: The check of edges.
        attempts: Number of pairs to try.
        rng: Draws the pairs.
    """
    for _ in range(attempts):
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        if not along[-1] > 0.0:
            return corners
        low, high = np.sort(rng.uniform(0.0, along[-1], 2))
        before, after = (np.searchsorted(along, value, side="right") - 1 for value in (low, high))
        after = min(after, len(lengths) - 1)
        if before == after:
            continue
        first, last = (
            corners[k] + (value - along[k]) / lengths[k] * (corners[k + 1] - corners[k])
            for k, value in ((before, low), (after, high))
        )
        if edges.is_free(first, last):
            corners = np.vstack([corners[: before + 1], first, last, corners[after + 1 :]])
            keep = np.r_[True, np.linalg.norm(np.diff(corners, axis=0), axis=1) > 1e-6]
            keep[-1] = True
            corners = corners[keep]
    return corners


def round_corners(corners: np.ndarray, edges: EdgeChecker, *, width: float) -> np.ndarray:
    """Returns an evenly sampled path (K, D) with corners rounded as far as there is room.

    Args:
        corners: (K, D) corners of a free path.
        edges: The check of edges; its resolution is also that of the returned path.
        width: Length over which corners are rounded, if there is room.
    """
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    count = max(int(np.ceil(along[-1] / edges.resolution)), 2)
    even = np.linspace(0.0, along[-1], count + 1)
    while width > edges.resolution:
        path = _smoothed(corners, along, even, width)
        if edges.are_free(path).all():
            return path
        width *= 0.5
    return _smoothed(corners, along, even, 0.0)


def _smoothed(corners: np.ndarray, along: np.ndarray, even: np.ndarray, width: float) -> np.ndarray:
    """Returns averages (K, D) of a path over windows centred at the lengths `even` (K,) along it.

    The windows have the length `width`, and are shorter near the ends. `along` has the corners'
    lengths along the path.
    """
    halves = np.minimum(0.5 * width, np.minimum(even, along[-1] - even))
    offsets = np.linspace(-1.0, 1.0, 21)
    at = np.clip(even[:, None] + halves[:, None] * offsets, 0.0, along[-1])
    values = np.stack([np.interp(at, along, corners[:, k]) for k in range(corners.shape[1])], -1)
    return values.mean(axis=1)
