"""Where the object is known not to be: the space that a camera saw through in the first frame.

Depth may agree with a wrong pose. A mug, for example, looks the same from all sides apart from its
handle. Points in the object's colours may then contradict the pose: moved with the object to its
first pose, the handle's points lie in space that a camera saw through. Background of the first
frame, such as a rod that the object hangs on, never contradicts a pose. The alignment's free-space
term turns the model's handle towards the points of a handle that a view shows beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import (
    NormalEquations,
    motion_jacobian,
    tukey_weights,
)
from poil_drake.perception.trackers.rigid_flow.reference_view import ReferenceView

FEW_OBSERVED = 20.0
"""Total weight of observed points at which their evidence counts half; less weight counts less."""

_TOLERANCE = 0.002  # how deep in free space a point may lie, because of pose errors [m]
_SURROUNDINGS = 0.04  # how far around the object free space is mapped [m]
_SPACING = 0.004  # of the grid [m]
_SOFTNESS = 0.008  # beyond _TOLERANCE the conflict grows from 0 to 1 over this distance [m]
_MARGIN = 0.02  # points up to this far beyond the object's radius count [m]

_GATE = 0.03  # points deeper than this in free space belong to something else [m]
_DEVIATION = 0.003  # of how deep in free space a point of the object is [m]
_CORRELATION = 4.0  # observed points that count as one, since their errors are correlated


@dataclass(frozen=True, eq=False)
class ObservedPoints:
    """Q points that the views show in the object's colours.

    Attributes:
        points: (Q, 3) float32 [m, world].
        weights: (Q,) float32 in (0, 1]: the confidence that the colour is the object's.
    """

    points: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True, eq=False)
class FreeSpaceGrid(SharedOnCopy):
    """A grid of the free space around the object, in the object's frame.

    Attributes:
        depth: (G, G, G) float32 distance into free space [m]; 0 where the object may be.
        corner: Coordinate at which the grid begins [m], which is the same along each axis.
        spacing: Edge of a cell [m].
    """

    depth: np.ndarray
    corner: float
    spacing: float

    def depth_at(self, points_O: Sequence[np.ndarray]) -> np.ndarray:
        """Returns how deep in free space points are [m].

        Args:
            points_O: x, y and z of the points [m, object], arrays of equal shape.
        """
        size = len(self.depth)
        index = np.zeros(points_O[0].shape, dtype=np.int32)
        for coordinate in points_O:
            cell = (coordinate - np.float32(self.corner)) * np.float32(1.0 / self.spacing)
            index *= size
            index += np.clip(cell, 0, size - 1).astype(np.int32)
        return self.depth.ravel()[index]

    def conflict(
        self, observed: ObservedPoints, poses: np.ndarray, radius: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compares observed points with each of many poses of the object.

        Args:
            observed: The points.
            poses: (P, 4, 4) poses of the object in the world.
            radius: Radius of the object [m].

        Returns:
            explained: (P,) weight of the points near the object that are not in free space.
            conflicting: (P,) weight of the points near the object that lie in free space.
        """
        X_OW = inverse(poses).astype(np.float32)
        R = np.ascontiguousarray(X_OW[:, :3, :3])
        points = (R @ observed.points.T + X_OW[:, :3, 3:]).transpose(1, 0, 2)
        near = (points * points).sum(axis=0) < np.float32(radius + _MARGIN) ** 2
        inside = self.depth_at(tuple(points)) - np.float32(_TOLERANCE)
        share = np.clip(inside * np.float32(1.0 / _SOFTNESS), 0.0, 1.0)
        conflicting = np.where(near, share, 0.0)
        explained = np.where(near, 1.0 - share, 0.0)
        return explained @ observed.weights, conflicting @ observed.weights


def map_free_space(views: Sequence[ReferenceView], radius: float) -> FreeSpaceGrid:
    """Maps the space around the object that any view saw through.

    Args:
        views: The views of the first frame.
        radius: Radius of the object [m].
    """
    reach = radius + _SURROUNDINGS
    size = int(np.ceil(2.0 * reach / _SPACING))
    axis = (np.arange(size) + 0.5) * _SPACING - reach
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    free = np.any([view.sees_through(grid) for view in views], axis=0)
    depth = distance_transform_edt(free.reshape(size, size, size), sampling=_SPACING)
    return FreeSpaceGrid(depth.astype(np.float32), -reach, _SPACING)


def add_free_space_term(
    equations: NormalEquations,
    free_space: FreeSpaceGrid,
    observed: ObservedPoints,
    X_WO: np.ndarray,
    radius: float,
) -> None:
    """Adds how deep the observed points lie in free space, as residuals.

    Args:
        equations: The equations to add to.
        free_space: Where the object is known not to be.
        observed: Points that have the object's colours.
        X_WO: (4, 4) pose of the object.
        radius: Radius of the object [m]. Points farther from the object's origin do not count.
    """
    points = transform_points(inverse(X_WO), observed.points)
    depth = free_space.depth_at(tuple(points.T)) - _TOLERANCE
    inside = (depth > 0.0) & (np.einsum("qi,qi->q", points, points) < radius**2)
    if not np.any(inside):
        return
    points, depth = points[inside], depth[inside]
    slopes = [
        free_space.depth_at(tuple((points + h).T)) - free_space.depth_at(tuple((points - h).T))
        for h in free_space.spacing * np.eye(3)
    ]
    outward = np.stack(slopes, axis=1) / (2.0 * free_space.spacing)
    # A motion d = (ω, v) of the object moves a point q of the world by -(v + ω x q) within it.
    jacobian = -motion_jacobian(points, outward)
    weights = observed.weights[inside] * tukey_weights(depth, _GATE)
    equations.add(jacobian, -depth, weights / (_DEVIATION**2 * _CORRELATION))
