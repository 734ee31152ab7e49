"""The marks of one role, lifted into space."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from poil_drake.geometry.depth_image import project, unproject
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.detectors.by_hand.hand_labels import HandLabels
from poil_drake.perception.images import CameraModel, MultiViewFrame

CLICK_REACH = 0.02
"""How far a click reaches [m] where neither a box nor another click bounds it."""

_BOX_MARGIN = 2.0  # [px] Boxes are drawn this exactly.
_OCCLUSION = 0.01  # [m] What is nearer than a point by more than this hides it.
_CELL, _STEP = 0.003, 0.008  # [m] Size of the nodes of paths on surfaces, and longest step.
_HOLE_RADIUS = 5  # [px] Half the width of the holes in the depth that one may click in.


@dataclass(frozen=True, eq=False)
class MarkedView:
    """One view and its marks of one role.

    Attributes:
        camera: The camera.
        rgb: (H, W, 3) uint8.
        depth: (H, W) [m]; 0 without depth.
        points: (H, W, 3) the pixels' points [m, world]; NaN without depth.
        box: (left, top, right, bottom) [px]; None if there is none.
        included: (n, 2) int, pixels (u, v) that are clicked on.
        excluded: (m, 2) int, pixels (u, v) that are clicked on as what is not meant.
    """

    camera: CameraModel
    rgb: np.ndarray
    depth: np.ndarray
    points: np.ndarray
    box: np.ndarray | None
    included: np.ndarray
    excluded: np.ndarray

    @property
    def marked(self) -> bool:
        """Whether this view says itself what is meant."""
        return self.box is not None or len(self.included) > 0

    @property
    def has_depth(self) -> np.ndarray:
        """(H, W) bool."""
        return np.isfinite(self.points[..., 0])

    def points_at(self, pixels: np.ndarray) -> np.ndarray:
        """Returns the points (k, 3) [m, world] at those of the pixels (n, 2) that have depth.

        Depth up to `_HOLE_RADIUS` pixels away will do.
        """
        found = []
        for u, v in pixels:
            rows, columns = (slice(max(x - _HOLE_RADIUS, 0), x + _HOLE_RADIUS + 1) for x in (v, u))
            y, x = np.nonzero(self.has_depth[rows, columns])
            if len(x):
                best = np.argmin((x + columns.start - u) ** 2 + (y + rows.start - v) ** 2)
                found.append(self.points[rows, columns][y[best], x[best]])
        return np.array(found).reshape(-1, 3)

    def allows(self, points: np.ndarray) -> np.ndarray:
        """Returns which points (n, 3) [m, world] the box does not exclude.

        It excludes what this view sees outside of it, or would see if it were there.
        """
        if self.box is None:
            return np.ones(len(points), dtype=bool)
        pixels, z = project(points, self.camera.K, self.camera.X_WC)
        at = np.rint(np.nan_to_num(pixels, nan=-1.0))
        in_image = np.all((at >= 0) & (at < [self.camera.width, self.camera.height]), axis=1)
        u, v = at[in_image].astype(int).T
        hidden = np.ones(len(points), dtype=bool)
        hidden[in_image] = (self.depth[v, u] > 0.0) & (self.depth[v, u] < z[in_image] - _OCCLUSION)
        lower, upper = self.box[:2] - _BOX_MARGIN, self.box[2:] + _BOX_MARGIN
        return hidden | np.all((pixels >= lower) & (pixels <= upper), axis=1)


@dataclass(frozen=True, eq=False)
class RoleMarks:
    """The marks of one role in all views.

    Attributes:
        views: The views.
        included: (n, 3) points that are clicked on [m, world].
        excluded: (m, 3) points that are clicked on as what is not meant [m, world].
        allowed: V masks (H, W) bool of the pixels that have depth and lie in the boxes of all
            views; all False if nothing is marked.
    """

    views: tuple[MarkedView, ...]
    included: np.ndarray
    excluded: np.ndarray
    allowed: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, frame: MultiViewFrame, labels: HandLabels, role: str) -> Self:
        """Returns the marks of a role."""
        views = []
        for camera, image in zip(frame.cameras, frame.images, strict=True):
            everywhere = np.ones(image.depth.shape, dtype=bool)
            points_C, pixels = unproject(image.depth, camera.K, everywhere)
            points = np.full((*image.depth.shape, 3), np.nan)
            points[pixels[:, 1], pixels[:, 0]] = transform_points(camera.X_WC, points_C)
            box = labels.box(camera.name, role)
            last = [camera.width - 1, camera.height - 1]
            included, excluded = (
                np.minimum(np.rint(labels.clicks(camera.name, role, include=include)), last)
                for include in (True, False)
            )
            views.append(
                MarkedView(
                    camera,
                    image.rgb,
                    image.depth,
                    points,
                    None if box is None else np.array(box),
                    included.astype(int),
                    excluded.astype(int),
                )
            )
        return cls(
            views=tuple(views),
            included=np.concatenate([view.points_at(view.included) for view in views]),
            excluded=np.concatenate([view.points_at(view.excluded) for view in views]),
            allowed=tuple(_allowed(view, views) for view in views),
        )

    @property
    def boxed(self) -> bool:
        """Whether any view has a box."""
        return any(view.box is not None for view in self.views)

    def not_excluded(self, points: np.ndarray, reach: float = np.inf) -> np.ndarray:
        """Returns which points (n, 3) the clicks do not exclude.

        Those are nearer, along the surface, to a click on what is meant than to others. If there
        are only clicks on what is not meant, they exclude what is within `CLICK_REACH`.

        Args:
            points: (n, 3) [m, world].
            reach: Points farther from the clicks on what is meant than this are excluded, too [m].
        """
        if not len(self.included) or not len(points):
            return distance_to(points, self.excluded) > CLICK_REACH
        chosen = distance_to(points, self.included) < reach
        if len(self.excluded):
            chosen &= _nearer_along_surface(points, self.included, self.excluded)
        return chosen


def _nearer_along_surface(
    points: np.ndarray, included: np.ndarray, excluded: np.ndarray
) -> np.ndarray:
    """Returns which points (n, 3) of surfaces are nearer to one kind of seeds than to the other.

    Distances are those of shortest paths in steps of at most `_STEP`, so that a gap separates.
    Where no path leads to a seed, the straight line counts.
    """
    _, index = np.unique(np.floor(points / _CELL).astype(int), axis=0, return_inverse=True)
    counts = np.bincount(index)
    nodes = np.stack([np.bincount(index, x) / counts for x in points.T], axis=1)
    tree = cKDTree(nodes)
    steps = tree.sparse_distance_matrix(tree, _STEP, output_type="coo_matrix")
    seeds = [np.unique(tree.query(these)[1]) for these in (included, excluded)]
    near, far = (dijkstra(steps.tocsr(), indices=these, min_only=True) for these in seeds)
    closer = distance_to(nodes, included) < distance_to(nodes, excluded)
    return np.where(np.isinf(near) & np.isinf(far), closer, near < far)[index]


def _allowed(view: MarkedView, views: Sequence[MarkedView]) -> np.ndarray:
    mask = view.has_depth & any(other.marked for other in views)
    mask[mask] = np.all([other.allows(view.points[mask]) for other in views], axis=0)
    return mask


def distance_to(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Returns the distance (n,) of each point to the nearest of others [m]; infinite if none."""
    if not len(others):
        return np.full(len(points), np.inf)
    return cKDTree(others).query(points)[0]
