"""The core of a part: what its surfaces, seen from whichever side, have in common."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.point_cloud import PointCloud


@dataclass(frozen=True, kw_only=True)
class PartCoreConfig:
    """How deep under its surface the core of a part lies.

    Attributes:
        max_depth: Deepest core that is looked for [m]: half the thickness of a thick handle. 0
            leaves the surface as it is.
        step: Resolution of the search [m].
        neighbours: Points of a neighbourhood. 32 points of a handle in 2 mm voxels are about 15 mm
            of its length.
    """

    max_depth: float = 0.008
    step: float = 0.0005
    neighbours: int = 32

    def __post_init__(self) -> None:
        if self.max_depth < 0.0 or self.step <= 0.0:
            raise InvalidValueError(
                f"PartCoreConfig has max_depth={self.max_depth} m and step={self.step} m.",
                remedy="The depth must not be negative, and the step positive.",
            )


def core_depth(part: PointCloud, config: PartCoreConfig | None = None) -> float:
    """Returns how deep under the surface the part's core lies [m].

    Surface points are moved against their normals by various depths. Half the thickness of a tube
    takes them to its centre line, where neighbours spread least across it; that depth is returned.
    On flat and on thick parts moving brings nothing together but noise, and the depth is small.

    Args:
        part: The part with normals.
        config: Parameters, None for the defaults.
    """
    config = config or PartCoreConfig()
    if part.normals is None:
        raise InvalidValueError(
            "core_depth() got a cloud without normals.", remedy="Fuse views with normals."
        )
    if len(part) < 3:
        return 0.0
    _, nearest = cKDTree(part.points).query(part.points, k=min(config.neighbours, len(part)))
    depths = np.arange(0.0, config.max_depth + 0.5 * config.step, config.step)
    spreads = [_spread(part.points - d * part.normals, nearest) for d in depths]
    return float(depths[int(np.argmin(spreads))])


def part_core(part: PointCloud, config: PartCoreConfig | None = None) -> PointCloud:
    """Returns the part's points moved inwards to its core, where all sides of a handle meet.

    Two cameras see one side of a handle in the demonstration and perhaps the other on the target.
    Surfaces would be aligned a thickness off, and tilted; cores are not. This goes beyond the paper.
    """
    depth = core_depth(part, config)
    assert part.normals is not None
    return PointCloud(part.points - depth * part.normals, part.normals, part.colors)


def _spread(points: np.ndarray, nearest: np.ndarray) -> float:
    """Returns the mean spread of neighbourhoods across their main direction."""
    arms = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
    variances = np.linalg.eigvalsh(np.swapaxes(arms, 1, 2) @ arms / nearest.shape[1])
    return float(np.mean(np.sqrt(np.maximum(variances[:, 0] + variances[:, 1], 0.0))))
