"""Finds what moved in a demonstration, by its first and its last frame."""

import cv2
import numpy as np
from scipy.spatial import cKDTree

from poil_drake.geometry.depth_image import unproject
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import CameraModel, MultiViewFrame

Masks = tuple[np.ndarray, ...]
"""One mask (H, W) bool for each view."""

_CHANGE = 0.012  # of the depth: noise changes it less
_SAME = 0.009  # of the depth: what stays changes it less
_HEIGHT = 0.004  # above the table, where an object begins [m]
_MIN_PIXELS = 50  # of what left its place, in a view
_LINK = 0.02  # the largest distance between what two views show of one object [m]
_NEAR, _NEAR_SHARE = 0.02, 0.3
"""What appeared is the object's if this share of it is this near to where the object went [m]."""


def departed_masks(
    first: MultiViewFrame, last: MultiViewFrame, *, table_height: float
) -> list[Masks]:
    """Returns the masks, in the first frame, of each thing that has left its place in the last one.

    The largest comes first. What stands still, or stood on the table at neither time, such as a
    hand that came and went, is not among them.

    Args:
        first: The first frame.
        last: The last frame, of the same cameras.
        table_height: Height of the plane on which objects stand [m, world].
    """
    pieces: list[tuple[int, np.ndarray, np.ndarray]] = []  # view, mask, points in the world
    for k, (camera, before, after) in enumerate(
        zip(first.cameras, first.images, last.images, strict=True)
    ):
        both = (before.depth > 0.0) & (after.depth > 0.0)
        change = (after.depth - before.depth) / np.maximum(before.depth, 1e-6)
        height = world_points(camera, before.depth)[..., 2]
        above = (before.depth > 0.0) & (height > table_height + _HEIGHT)
        gone = _opened(both & above & (change > _CHANGE))
        count, pieces_image = _components(above & ~(both & (np.abs(change) < _SAME)))
        sizes = np.bincount(pieces_image[gone], minlength=count)
        for piece in np.flatnonzero(sizes[1:] >= _MIN_PIXELS) + 1:
            mask = pieces_image == piece
            points, _ = unproject(before.depth, camera.K, mask)
            pieces.append((k, mask, transform_points(camera.X_WC, points)))
    groups = _linked([points for _, _, points in pieces])
    found = []
    for group in groups:
        masks = [np.zeros(image.depth.shape, dtype=bool) for image in first.images]
        for index in group:
            masks[pieces[index][0]] |= pieces[index][1]
        found.append(tuple(masks))
    return sorted(found, key=lambda masks: -sum(int(mask.sum()) for mask in masks))


def arrived_masks(
    first: MultiViewFrame, last: MultiViewFrame, points: np.ndarray, *, table_height: float
) -> Masks:
    """Returns an object's masks in the last frame.

    Args:
        first: The first frame.
        last: The last frame.
        points: (P, 3) the points that the first frame showed of the object, at their places in the
            last one [m, world].
        table_height: Height of the plane on which objects stand [m, world].
    """
    tree, masks = cKDTree(points), []
    for camera, before, after in zip(first.cameras, first.images, last.images, strict=True):
        change = (before.depth - after.depth) / np.maximum(after.depth, 1e-6)
        where = world_points(camera, after.depth)
        new = (after.depth > 0.0) & ((before.depth == 0.0) | (change > 0.5 * _CHANGE))
        new &= where[..., 2] > table_height + _HEIGHT
        near = np.zeros(new.shape, dtype=bool)
        near[new] = tree.query(where[new], distance_upper_bound=_NEAR)[0] < _NEAR
        count, pieces = _components(new)
        sizes = np.bincount(pieces.ravel(), minlength=count)
        share = np.bincount(pieces[near], minlength=count) / np.maximum(sizes, 1)
        masks.append((share > _NEAR_SHARE)[pieces] & new)
    return tuple(masks)


def world_points(camera: CameraModel, depth: np.ndarray) -> np.ndarray:
    """Returns the point of each pixel, (H, W, 3) [m, world]; the camera's centre without depth."""
    points, _ = unproject(np.where(depth > 0.0, depth, 1e-9), camera.K, np.ones(depth.shape, bool))
    return transform_points(camera.X_WC, points).reshape(*depth.shape, 3)


def _opened(mask: np.ndarray) -> np.ndarray:
    """Returns a mask without specks of noise."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return opened.astype(bool)


def _components(mask: np.ndarray) -> tuple[int, np.ndarray]:
    """Returns the number of numbers and the number of each pixel's component, 0 outside."""
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)


def _linked(clouds: list[np.ndarray]) -> list[list[int]]:
    """Returns groups of the clouds (P, 3) [m] that are near one another."""
    trees, groups = [cKDTree(cloud) for cloud in clouds], list[list[int]]()
    for k, tree in enumerate(trees):
        near = [g for g in groups if any(_near(tree, trees[j]) for j in g)]
        groups = [g for g in groups if g not in near] + [[k, *(j for g in near for j in g)]]
    return groups


def _near(a: cKDTree, b: cKDTree) -> bool:
    return bool(np.min(a.query(b.data)[0]) < _LINK)
