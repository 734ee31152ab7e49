"""Grows a region of an object to the thin piece on which it lies, such as a handle."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

_DEEP = 0.008  # points up to this much farther than the nearest one touch [m]
_REACH = 0.008  # between neighbours on the surface [m]
_BAND = 0.006  # width of the rings in which the region grows [m]
_WIDER = 1.5  # a ring this much wider than the narrowest one before it leaves the thin piece
_NARROW = 0.012  # rings count as at least this wide [m]


def contact_region(points: np.ndarray, distances: np.ndarray) -> np.ndarray:
    """Returns which points (P,) bool of an object belong to the part with which it touches.

    Args:
        points: (P, 3) the object's surface, in steps of about 3 mm [m].
        distances: (P,) distances from what the object touches [m].
    """
    return grown_along_thin_piece(points, distances < distances.min() + _DEEP)


def grown_along_thin_piece(points: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Returns which points (P,) bool belong to the thin piece of an object around some of them.

    The region grows along the surface, ring by ring, each piece of a ring for itself, until the
    pieces get wider: a mug's handle ends where it meets the body. On a flat side, the region hardly
    grows.

    Args:
        points: (P, 3) the object's surface, in steps of about 3 mm [m].
        start: (P,) bool, where the region starts.
    """
    region = start.copy()
    pairs = cKDTree(points).query_pairs(_REACH, output_type="ndarray")
    lengths = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    ways = dijkstra(
        _graph(pairs, lengths, len(points)),
        directed=False,
        indices=np.flatnonzero(region),
        min_only=True,
    )
    ring = np.where(np.isfinite(ways), np.ceil(ways / _BAND), -1).astype(int)
    within = pairs[ring[pairs[:, 0]] == ring[pairs[:, 1]]]
    _, piece = connected_components(_graph(within, np.ones(len(within)), len(points)), False)
    narrowest = np.where(region, max(_width(points[region]), _NARROW), np.inf)
    for k in range(1, ring.max() + 1):
        grown = False
        for own in (np.flatnonzero((ring == k) & (piece == p)) for p in set(piece[ring == k])):
            gap, before = cKDTree(points[region]).query(points[own])
            if gap.min() > _REACH:
                continue
            width = _width(points[own])
            least = narrowest[region][before[np.argmin(gap)]]
            if width <= _WIDER * least:
                region[own] = grown = True
                narrowest[own] = max(min(least, width), _NARROW)
        if not grown:
            break
    return region


def _graph(pairs: np.ndarray, values: np.ndarray, count: int) -> csr_matrix:
    return csr_matrix((values, (pairs[:, 0], pairs[:, 1])), shape=(count, count))


def _width(points: np.ndarray) -> float:
    """Returns twice the largest distance from the centroid [m]."""
    return 2.0 * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
