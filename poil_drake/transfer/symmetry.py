"""Symmetry of a part under half turns about its principal axes (POIL section III-B)."""

import numpy as np
from scipy.spatial import cKDTree

SYMMETRY_TOLERANCE = 0.15
"""Largest Chamfer distance between a symmetric part and its turned copy, relative to the part's
root mean square radius. For a handle of 25 mm by 8 mm seen from one side, the distance is 0.15."""

_KEPT = 0.8  # Fraction of the points that count, nearest first; the rest may have no counterpart.


def half_turns(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compares a part with its copies turned by 180 degrees about its principal axes.

    Args:
        points: (P, 3) the part [m].

    Returns:
        The rotation matrices (3, 3, 3), starting with the axis of the largest extent, and the
        trimmed mean distances (3,) between the part and its turned copies, relative to the part's
        root mean square radius.
    """
    arms = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(arms.T @ arms)
    radius = float(np.sqrt(np.mean(np.sum(arms**2, axis=1))))
    tree = cKDTree(arms)
    count = max(1, round(_KEPT * len(arms)))
    turns = np.array([2.0 * np.outer(axis, axis) - np.eye(3) for axis in axes.T[::-1]])
    # A half turn is its own inverse, so both directions have the same distances.
    distances = [np.sort(tree.query(arms @ turn.T)[0])[:count].mean() for turn in turns]
    return turns, np.array(distances) / max(radius, 1e-12)
