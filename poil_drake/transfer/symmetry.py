"""Symmetry of a part under half turns about its principal axes (POIL section III-B)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.frozen_array import SharedOnCopy


@dataclass(frozen=True, kw_only=True)
class SymmetryConfig:
    """When a part counts as symmetric.

    Attributes:
        tolerance: Largest Chamfer distance between the part and its turned copy, relative to its
            root mean square radius. A handle seen from one side only, 25 mm large and 8 mm thick,
            differs by about 0.15 from itself turned.
        kept: Share of the points, nearest first, that count in each direction: the rest may be
            what only one side shows.
    """

    tolerance: float = 0.15
    kept: float = 0.8


@dataclass(frozen=True, eq=False)
class HalfTurn(SharedOnCopy):
    """A part turned by 180 degrees about one of its principal axes.

    Attributes:
        axis: (3,) unit vector.
        rotation: (3, 3) the half turn.
        chamfer: Trimmed mean distance between the part and its turned copy, of both directions,
            relative to the part's root mean square radius.
        symmetric: Whether that is within the tolerance.
    """

    axis: np.ndarray
    rotation: np.ndarray
    chamfer: float
    symmetric: bool


def half_turns(
    points: np.ndarray, config: SymmetryConfig | None = None
) -> tuple[HalfTurn, HalfTurn, HalfTurn]:
    """Returns the Chamfer test of a part after turning it about each principal axis.

    Args:
        points: (P, 3) the part [m].
        config: Parameters, None for the defaults.

    Returns:
        One for each principal axis, that of the largest extent first.
    """
    config = config or SymmetryConfig()
    arms = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(arms.T @ arms)
    radius = float(np.sqrt(np.mean(np.sum(arms**2, axis=1))))
    tree = cKDTree(arms)

    def test(axis: np.ndarray) -> HalfTurn:
        rotation = 2.0 * np.outer(axis, axis) - np.eye(3)
        # A half turn is its own inverse, so both directions have the same distances.
        distances, _ = tree.query(arms @ rotation.T)
        count = max(1, round(config.kept * len(arms)))
        chamfer = float(np.sort(distances)[:count].mean()) / max(radius, 1e-12)
        return HalfTurn(axis, rotation, chamfer, chamfer <= config.tolerance)

    return test(axes[:, 2]), test(axes[:, 1]), test(axes[:, 0])
