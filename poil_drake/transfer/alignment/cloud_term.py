"""How well one placed cloud covers another: a truncated Chamfer distance and its gradient."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import skew
from poil_drake.geometry.sampling import farthest_point_sampling
from poil_drake.transfer.alignment.nearest_neighbours import NearestNeighbours, nearest_both_ways
from poil_drake.transfer.alignment.state import AlignmentState, NormalEquations

PART_CLOUD, CONTEXT_CLOUD = 0, 1
"""Which scales and translation of an AlignmentState a term is about."""

_OWN_COLUMNS = (np.r_[0:3, 3:9], np.r_[0:3, 9:15])


@dataclass(frozen=True, eq=False)
class CloudFrame:
    """How a demonstrated cloud and a target cloud are made comparable.

    Attributes:
        source_center: (3,) centroid of the demonstrated cloud [m].
        target_center: (3,) centroid of the target cloud [m].
        length: Mean of both clouds' root mean square radii [m]: the unit of length.
        axes: (3, 3) columns are the demonstrated cloud's principal axes, right-handed.
    """

    source_center: np.ndarray
    target_center: np.ndarray
    length: float
    axes: np.ndarray

    @classmethod
    def between(cls, source: np.ndarray, target: np.ndarray) -> "CloudFrame":
        """Returns the frame of two clouds (P, 3) and (Q, 3) [m]."""
        centers = source.mean(axis=0), target.mean(axis=0)
        arms = source - centers[0], target - centers[1]
        radii = [np.sqrt(np.mean(np.sum(a * a, axis=1))) for a in arms]
        _, axes = np.linalg.eigh(arms[0].T @ arms[0])
        axes = axes * np.array([1.0, 1.0, np.sign(np.linalg.det(axes))])
        return cls(*centers, float(np.mean(radii)), axes)


class Placement(NamedTuple):
    """Source points under K candidates.

    Attributes:
        points: (K, n, 3) in units of the frame's length, about the target's centre.
        jacobian: (K, n, 3, 9) of the points: by rotation, logarithmic scales and translation.
    """

    points: np.ndarray
    jacobian: np.ndarray


@dataclass(frozen=True, eq=False)
class CloudTerm:
    """Compares a demonstrated cloud, placed by a candidate, with a target cloud.

    The energy is the mean over both directions of 1 - exp(-d^2 / 2 w^2), d the distance to the
    nearest neighbour: a Chamfer distance in which what has no counterpart, because only one of the
    scenes shows it, counts a constant. With normals, two points are also the farther apart the more
    their normals differ, so that the inside of a wall does not pass for its outside.

    Attributes:
        frame: Makes the clouds comparable.
        source: (n, 3) demonstrated points in the frame's units, spread over the cloud best first.
        target: (m, 3) target points, likewise.
        source_normals: (n, 3) unit normals times their weight; zeros if they do not count.
        target_normals: (m, 3) likewise.
        metric: (m, 3, 3) what part of an offset from a target point counts in the descent:
            everything across its surface, little along it, where the clouds may slide.
        cloud: PART_CLOUD or CONTEXT_CLOUD.
    """

    frame: CloudFrame
    source: np.ndarray
    target: np.ndarray
    source_normals: np.ndarray
    target_normals: np.ndarray
    metric: np.ndarray
    cloud: int

    @classmethod
    def between(
        cls,
        source: PointCloud,
        target: PointCloud,
        *,
        cloud: int,
        max_points: int,
        normal_weight: float,
        tangential_weight: float,
    ) -> "CloudTerm":
        """Returns the term of two clouds.

        Args:
            source: The demonstrated cloud.
            target: The target cloud.
            cloud: PART_CLOUD or CONTEXT_CLOUD.
            max_points: At most this many points of each are used.
            normal_weight: Distance of opposite normals, over twice the unit of length. 0: not used.
            tangential_weight: What offsets along the surface count in the descent, of 1.
        """
        frame = CloudFrame.between(source.points, target.points)
        chosen, sides = [], [(source, frame.source_center), (target, frame.target_center)]
        for side, center in sides:
            order = farthest_point_sampling(side.points, min(max_points, len(side)))
            normals = np.zeros((len(order), 3))
            if normal_weight > 0.0 and side.normals is not None:
                normals = normal_weight * side.normals[order]
            chosen += [(side.points[order] - center) / frame.length, normals]
        everything = (target.points - frame.target_center) / frame.length
        metric = _surface_metric(chosen[2], everything, tangential_weight)
        return cls(frame, chosen[0], chosen[2], chosen[1], chosen[3], metric, cloud)

    def thinned(self, count: int) -> "CloudTerm":
        """Returns the term of the first points of both clouds, which are spread evenly."""
        return replace(
            self,
            source=self.source[:count],
            target=self.target[:count],
            source_normals=self.source_normals[:count],
            target_normals=self.target_normals[:count],
            metric=self.metric[:count],
        )

    def place(self, state: AlignmentState, points: np.ndarray | None = None) -> Placement:
        """Returns where candidates put source points, and the derivatives.

        Args:
            state: K candidates.
            points: (n, 3) in the frame's units about the source's centre; None for `source`.
        """
        points = self.source if points is None else points
        turned_axes = state.R @ self.frame.axes
        scaled = np.exp(state.log_scales[:, self.cloud])[:, None, :] * (points @ self.frame.axes)
        arms = scaled @ np.swapaxes(turned_axes, 1, 2)
        jacobian = np.empty((*arms.shape, 9))
        jacobian[..., 0:3] = -skew(arms)
        jacobian[..., 3:6] = turned_axes[:, None] * scaled[:, :, None, :]
        jacobian[..., 6:9] = np.eye(3)
        return Placement(arms + state.translations[:, None, self.cloud], jacobian)

    def energy(self, state: AlignmentState, width: float) -> np.ndarray:
        """Returns the energies (K,) in [0, 1]; `width` is w in units of length."""
        nearest = self._match(state, self.place(state).points)
        forward = -np.expm1(-nearest.source_squares / (2.0 * width**2))
        backward = -np.expm1(-nearest.target_squares / (2.0 * width**2))
        return 0.5 * (forward.mean(axis=1) + backward.mean(axis=1))

    def linearize(
        self, state: AlignmentState, width: float, weight: float, equations: NormalEquations
    ) -> None:
        """Adds the Gauss-Newton approximation of weight times the energy."""
        placement = self.place(state)
        nearest = self._match(state, placement.points)
        j, i = nearest.target_of_source, nearest.source_of_target
        sides = (
            (nearest.source_squares, placement, self.target[j], self.metric[j]),
            (
                nearest.target_squares,
                Placement(
                    np.take_along_axis(placement.points, i[..., None], axis=1),
                    np.take_along_axis(placement.jacobian, i[..., None, None], axis=1),
                ),
                self.target[None],
                self.metric[None],
            ),
        )
        for squares, placed, target, metric in sides:
            w = 0.5 * weight / (width**2 * squares.shape[1]) * np.exp(-squares / (2.0 * width**2))
            residual = (metric @ (placed.points - target)[..., None])[..., 0]
            equations.add(_OWN_COLUMNS[self.cloud], metric @ placed.jacobian, residual, w)

    def _match(self, state: AlignmentState, points: np.ndarray) -> NearestNeighbours:
        if not self.target_normals.any():
            return nearest_both_ways(points, self.target)
        normals = self.source_normals @ np.swapaxes(state.R, 1, 2)
        return nearest_both_ways(
            np.concatenate([points, normals], axis=2),
            np.concatenate([self.target, self.target_normals], axis=1),
        )


def _surface_metric(points: np.ndarray, cloud: np.ndarray, tangential: float) -> np.ndarray:
    """Returns (m, 3, 3) square roots of what offsets count around points, by the local spread."""
    _, nearest = cKDTree(cloud).query(points, k=min(20, len(cloud)))
    arms = cloud[nearest] - cloud[nearest].mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.swapaxes(arms, 1, 2) @ arms)
    share = 1.0 - spread / np.maximum(spread[:, 2:], 1e-12)
    counted = np.sqrt(tangential + (1.0 - tangential) * share)
    return (axes * counted[:, None, :]) @ np.swapaxes(axes, 1, 2)
