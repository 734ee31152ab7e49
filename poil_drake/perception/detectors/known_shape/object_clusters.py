"""Divides what stands on the table into clusters of points."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from poil_drake.perception.detectors.known_shape.moved_object import Masks, world_points
from poil_drake.perception.images import MultiViewFrame

_HEIGHT = 0.005  # above the table, where objects begin [m]
_BACKGROUND = 0.012  # points this near to the background belong to it [m]
_CELL = 0.006  # edge of the cells that are linked [m]
_LINK = 0.012  # distance of cells that belong together [m]
_MIN_CELLS = 20  # of a cluster
_MAX_SIZE = 0.6  # of a cluster along an axis [m]; walls are larger


def object_clusters(
    frame: MultiViewFrame, *, table_height: float, background: np.ndarray
) -> list[Masks]:
    """Returns the masks of each cluster of points above the table.

    Args:
        frame: The views.
        table_height: Height of the plane on which objects stand [m, world].
        background: (B, 3) points of what is no object, such as the fixture [m, world].
    """
    wheres = [world_points(c, i.depth) for c, i in zip(frame.cameras, frame.images, strict=True)]
    masks = [
        (image.depth > 0.0) & (where[..., 2] > table_height + _HEIGHT)
        for image, where in zip(frame.images, wheres, strict=True)
    ]
    if len(background):
        tree = cKDTree(background)
        for mask, where in zip(masks, wheres, strict=True):
            near = tree.query(where[mask], distance_upper_bound=_BACKGROUND)[0] < _BACKGROUND
            mask[mask] = ~near
    points = np.concatenate([where[mask] for where, mask in zip(wheres, masks, strict=True)])
    if not len(points):
        return []
    cells, cell = np.unique(np.floor(points / _CELL), axis=0, return_inverse=True)
    pairs = cKDTree(cells * _CELL).query_pairs(_LINK, output_type="ndarray")
    links = csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (len(cells), len(cells)))
    count, cluster = connected_components(links, directed=False)
    found = []
    for k in range(count):
        own = cells[cluster == k]
        if len(own) < _MIN_CELLS or np.ptp(own, axis=0).max() * _CELL > _MAX_SIZE:
            continue
        chosen, start = (cluster == k)[cell.ravel()], 0
        views = []
        for mask in masks:
            view = np.zeros(mask.shape, dtype=bool)
            view[mask] = chosen[start : start + int(mask.sum())]
            start += int(mask.sum())
            views.append(view)
        found.append(tuple(views))
    return found
