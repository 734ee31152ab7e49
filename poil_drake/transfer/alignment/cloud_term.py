"""How well one placed cloud covers another: a truncated Chamfer distance and its gradient."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.point_cloud import PointCloud, farthest_point_sampling
from poil_drake.geometry.rigid_transform import skew
from poil_drake.transfer.alignment.state import AlignmentState, NormalEquations

Neighbours = tuple[np.ndarray, np.ndarray]
"""For each point of K placements of a cloud, (K, n) the index of the nearest point of the other
cloud, and (K, n) the squared distance to it."""

PART_CLOUD, CONTEXT_CLOUD = 0, 1
"""Index of the part and of its context in the scales and translations of an `AlignmentState`."""

_OWN_COLUMNS = (np.r_[0:3, 3:9], np.r_[0:3, 9:15])
_MAX_POINTS = 1500  # Of each cloud.
_TANGENTIAL_WEIGHT = 0.3  # Of offsets along the surface, relative to offsets across it.


@dataclass(frozen=True, eq=False)
class CloudFrame:
    """Centres, unit of length and axes that make a demonstrated and a target cloud comparable.

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


@dataclass(frozen=True, eq=False)
class CloudTerm:
    """Compares a demonstrated cloud, placed by a candidate, with a target cloud.

    The energy is the mean over both directions of 1 - exp(-d^2 / 2 w^2), where d is the distance to
    the nearest neighbour. Each point that only one of the scenes shows, and that therefore has no
    counterpart, costs a constant. With normals, d also grows with the difference between two
    points' normals, so that the inside of a wall is not mistaken for its outside.

    Attributes:
        frame: Makes the clouds comparable.
        source: (n, 3) demonstrated points about their centre, in units of `frame.length`, ordered
            so that the first k are spread evenly over the cloud, for every k.
        target: (m, 3) target points about their centre, likewise.
        source_normals: (n, 3) unit normals times their weight; zeros if normals are ignored.
        target_normals: (m, 3) likewise.
        metric: (m, 3, 3) matrices by which the descent multiplies offsets from the target points.
            They keep offsets across the surface and shrink those along it, so that clouds can
            slide.
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
        normal_weight: float = 0.0,
    ) -> "CloudTerm":
        """Returns the term of two clouds.

        Args:
            source: The demonstrated cloud.
            target: The target cloud.
            cloud: PART_CLOUD or CONTEXT_CLOUD.
            normal_weight: Length of the normals in units of `CloudFrame.length`. Coincident points
                with opposite normals are twice this far apart. 0 ignores normals.
        """
        frame = CloudFrame.between(source.points, target.points)

        def sampled(side: PointCloud, center: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            order = farthest_point_sampling(side.points, min(_MAX_POINTS, len(side)))
            points = (side.points[order] - center) / frame.length
            if side.normals is None:
                return points, np.zeros_like(points)
            return points, normal_weight * side.normals[order]

        source_points, source_normals = sampled(source, frame.source_center)
        target_points, target_normals = sampled(target, frame.target_center)
        everything = (target.points - frame.target_center) / frame.length
        metric = _surface_metric(target_points, everything)
        return cls(
            frame, source_points, target_points, source_normals, target_normals, metric, cloud
        )

    def thinned(self, count: int) -> "CloudTerm":
        """Returns the term with at most `count` evenly spread points of each cloud."""
        thinned = ("source", "target", "source_normals", "target_normals", "metric")
        return replace(self, **{name: getattr(self, name)[:count] for name in thinned})

    def place(self, state: AlignmentState, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns where each of K candidates places demonstrated points.

        Args:
            state: K candidates.
            points: (n, 3) points about the source's centre, in units of `frame.length`.

        Returns:
            The points (K, n, 3) about the target's centre, in the same units, and their Jacobian
            (K, n, 3, 9) in rotation, logarithmic scales and translation.
        """
        turned_axes = state.R @ self.frame.axes
        scaled = np.exp(state.log_scales[:, self.cloud])[:, None, :] * (points @ self.frame.axes)
        arms = scaled @ np.swapaxes(turned_axes, 1, 2)
        jacobian = np.empty((*arms.shape, 9))
        jacobian[..., 0:3] = -skew(arms)
        jacobian[..., 3:6] = turned_axes[:, None] * scaled[:, :, None, :]
        jacobian[..., 6:9] = np.eye(3)
        return arms + state.translations[:, None, self.cloud], jacobian

    def energy(self, state: AlignmentState, width: float) -> np.ndarray:
        """Returns the energies (K,), in [0, 1]; `width` is w, in units of `frame.length`."""
        points, _ = self.place(state, self.source)
        (_, source_squares), (_, target_squares) = self._match(state, points)
        forward = -np.expm1(-source_squares / (2.0 * width**2))
        backward = -np.expm1(-target_squares / (2.0 * width**2))
        return 0.5 * (forward.mean(axis=1) + backward.mean(axis=1))

    def linearize(
        self, state: AlignmentState, width: float, weight: float, equations: NormalEquations
    ) -> None:
        """Adds the Gauss-Newton approximation of `weight` times the energy to `equations`."""
        points, jacobian = self.place(state, self.source)
        (j, source_squares), (i, target_squares) = self._match(state, points)
        nearest_points = np.take_along_axis(points, i[..., None], axis=1)
        nearest_jacobian = np.take_along_axis(jacobian, i[..., None, None], axis=1)
        for squares, offset, slope, metric in (
            (source_squares, points - self.target[j], jacobian, self.metric[j]),
            (target_squares, nearest_points - self.target, nearest_jacobian, self.metric),
        ):
            w = 0.5 * weight / (width**2 * squares.shape[1]) * np.exp(-squares / (2.0 * width**2))
            residual = (metric @ offset[..., None])[..., 0]
            equations.add(_OWN_COLUMNS[self.cloud], metric @ slope, residual, w)

    def _match(self, state: AlignmentState, points: np.ndarray) -> tuple[Neighbours, Neighbours]:
        if not self.target_normals.any():
            return nearest_both_ways(points, self.target)
        normals = self.source_normals @ np.swapaxes(state.R, 1, 2)
        return nearest_both_ways(
            np.concatenate([points, normals], axis=2),
            np.concatenate([self.target, self.target_normals], axis=1),
        )


def _surface_metric(points: np.ndarray, cloud: np.ndarray) -> np.ndarray:
    """Returns `CloudTerm.metric` (m, 3, 3) at points (m, 3) of a cloud (P, 3)."""
    _, nearest = cKDTree(cloud).query(points, k=min(20, len(cloud)))
    arms = cloud[nearest] - cloud[nearest].mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.swapaxes(arms, 1, 2) @ arms)
    share = 1.0 - spread / np.maximum(spread[:, 2:], 1e-12)
    counted = np.sqrt(_TANGENTIAL_WEIGHT + (1.0 - _TANGENTIAL_WEIGHT) * share)
    return (axes * counted[:, None, :]) @ np.swapaxes(axes, 1, 2)


def nearest_both_ways(sources: np.ndarray, target: np.ndarray) -> tuple[Neighbours, Neighbours]:
    """Returns the neighbours of the sources in the target, and of the target in the sources.

    |a - b|^2 is least where a . b - |b|^2 / 2 is greatest, so matrix products search all pairs.
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
    source_squares = np.sum((sources - target[j]) ** 2, axis=-1)
    target_squares = np.sum((nearest_source - target) ** 2, axis=-1)
    return (j, source_squares), (i, target_squares)


def _with(points: np.ndarray, last: np.ndarray | float) -> np.ndarray:
    """Returns the points with `last` appended as one more coordinate, in single precision."""
    column = np.broadcast_to(np.float32(last), points.shape[:-1])[..., None]
    return np.concatenate([points, column.astype(np.float32)], axis=-1)
