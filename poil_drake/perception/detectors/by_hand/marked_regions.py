"""Masks of what boxes and clicks mark in several views, by depth, colour and the other views."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from poil_drake.geometry.depth_image import erode_mask, project, unproject
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.detectors.by_hand.hand_labels import HandLabels
from poil_drake.perception.detectors.by_hand.support_plane import off_support
from poil_drake.perception.images import CameraModel, MultiViewFrame

_BOX_MARGIN = 2.0  # [px] Boxes are drawn this exactly; near the image's border they have no end.
_OCCLUSION = 0.01  # [m] What is nearer than a point by more than this hides it.
_HOLE_RADIUS = 5  # [px] Half the width of the holes in the depth that one may click in.
_SCENE_REACH = 0.6  # [m] from the marks; what is farther away is not part of what they mark
_GAP = 0.01  # [m] Surfaces that are nearer to each other than this, or twice this, are one piece.
_PIECE_SHARE = 0.5  # Least share of a piece's pixels in the boxes if the boxes mean the piece.
_CLICK_REACH = 0.015  # [m] A click beside a thin piece, this near, is on the piece.
_PART_REACH = 0.02  # [m] How far a click on a part reaches if no box bounds the part.
_CARRIED_REACH = 0.01  # [m] How far the part in the marked views reaches in the others.
_SURE_DEPTH = 1  # [px] from the border of the first guess: surely foreground
_UNSURE_BORDER = 3  # [px] outside of the first guess, in which the outline may be
_SEED_RADIUS = 3  # [px] of the disc around a click that surely belongs to its side
_CROP_MARGIN = 20  # [px] Width of the background whose colours count.
_GRAB_CUT_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class _View:
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

        It excludes those outside of its pyramid, except those that this view cannot see because
        something is in front of them.
        """
        if self.box is None:
            return np.ones(len(points), dtype=bool)
        last = np.array([self.camera.width, self.camera.height]) - 1
        lower, upper = self.box[:2] - _BOX_MARGIN, self.box[2:] + _BOX_MARGIN
        lower[lower <= 0.0] = -np.inf
        upper[upper >= last] = np.inf
        pixels, z = project(points, self.camera.K, self.camera.X_WC)
        inside = np.all((pixels >= lower) & (pixels <= upper), axis=1)
        at = np.clip(np.nan_to_num(np.rint(pixels), nan=-1.0), -1, last + 1).astype(int)
        seen = np.all((at >= 0) & (at <= last), axis=1)
        front = np.zeros(len(points))
        front[seen] = np.nan_to_num(self.depth[at[seen, 1], at[seen, 0]])
        return inside | (seen & (front > 0.0) & (front < z - _OCCLUSION))


@dataclass(frozen=True, eq=False)
class _Marks:
    """The marks of one role in all views.

    Attributes:
        views: The views.
        included: (n, 3) points that are clicked on [m, world].
        excluded: (m, 3) points that are clicked on as what is not meant [m, world].
        allowed: V masks (H, W) bool of the pixels that have depth and lie in the boxes of all
            views; all False if nothing is marked.
    """

    views: tuple[_View, ...]
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
                _View(
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

    def nearer_to_included(self, points: np.ndarray, reach: float = np.inf) -> np.ndarray:
        """Returns which points (n, 3) are nearer to a click on what is meant than to others.

        Without a click on what is meant, all are.

        Args:
            points: (n, 3) [m, world].
            reach: Points farther from the clicks than this are not [m].
        """
        if not len(self.included):
            return np.ones(len(points), dtype=bool)
        return _distance(points, self.included) < np.minimum(
            _distance(points, self.excluded), reach
        )


def _allowed(view: _View, views: Sequence[_View]) -> np.ndarray:
    mask = view.has_depth & any(other.marked for other in views)
    mask[mask] = np.all([other.allows(view.points[mask]) for other in views], axis=0)
    return mask


def region_masks(frame: MultiViewFrame, labels: HandLabels, role: str) -> tuple[np.ndarray, ...]:
    """Returns the mask (H, W) bool of an object or a fixture in each view.

    Every box is a pyramid in space. Without the surface on which things stand, the scene falls
    into pieces; those that lie mostly in all pyramids, or that are clicked on, are the first guess
    in all views, also in those without marks. GrabCut finds its outline by colour.

    Args:
        frame: The views.
        labels: The marks; see `HandLabels`.
        role: The role in the marks.
    """
    marks = _Marks.of(frame, labels, role)
    guesses, sure = _first_guesses(marks)
    return tuple(
        _grab_cut(view, guess, allowed, sure) & allowed
        for view, guess, allowed in zip(marks.views, guesses, marks.allowed, strict=True)
    )


def part_masks(
    frame: MultiViewFrame, labels: HandLabels, role: str, objects: Sequence[np.ndarray]
) -> tuple[np.ndarray, ...]:
    """Returns the mask (H, W) bool of a part of an object in each view.

    The part is what the boxes of all views enclose of the object, and what is nearer to a click on
    the part than to a click on the rest. Without a box, a click on the part reaches `_PART_REACH`
    far. Colour does not count, since a part often has that of its object.

    Args:
        frame: The views.
        labels: The marks; see `HandLabels`.
        role: The part's role in the marks.
        objects: The object's mask (H, W) bool in each view.
    """
    marks = _Marks.of(frame, labels, role)
    masks = [mask & allowed for mask, allowed in zip(objects, marks.allowed, strict=True)]
    for view, mask in zip(marks.views, masks, strict=True):
        reach = np.inf if marks.boxed else _PART_REACH
        mask[mask] = marks.nearer_to_included(view.points[mask], reach)
    seen = [view.points[mask] for view, mask in zip(marks.views, masks, strict=True) if view.marked]
    for view, mask in zip(marks.views, masks, strict=True):
        if not view.marked and seen:
            distance = _distance(view.points[mask], np.concatenate(seen))
            mask[mask] = distance < _CARRIED_REACH
    return tuple(masks)


def _first_guesses(marks: _Marks) -> tuple[list[np.ndarray], bool]:
    """Returns a mask (H, W) bool for each view, and whether it is sure but for its border.

    It is not sure if no surface is found on which things stand.
    """
    clouds = [view.points[view.has_depth] for view in marks.views]
    points = np.concatenate(clouds)
    allowed = np.concatenate(
        [mask[view.has_depth] for mask, view in zip(marks.allowed, marks.views, strict=True)]
    )
    from_boxed = [
        np.full(len(c), v.box is not None) for c, v in zip(clouds, marks.views, strict=True)
    ]
    boxed = np.concatenate(from_boxed)
    known = points[allowed & boxed] if marks.boxed else marks.included
    if not len(known):
        return [np.zeros_like(mask) for mask in marks.allowed], False
    centre = np.median(known, axis=0)
    eyes = np.array([view.camera.X_WC[:3, 3] for view in marks.views])
    standing = off_support(points, around=centre, among=~(allowed & boxed), seen_from=eyes)
    chosen = allowed.copy()
    if standing is not None:
        chosen &= standing
        near = np.linalg.norm(points - centre, axis=1) < _SCENE_REACH
        meant = _pieces_meant(points, standing & near, allowed, boxed, marks.included)
        if meant.any():
            chosen &= meant
    chosen[chosen] = marks.nearer_to_included(points[chosen])
    guesses = [view.has_depth for view in marks.views]
    ends = np.cumsum([len(cloud) for cloud in clouds])[:-1]
    for guess, part in zip(guesses, np.split(chosen, ends), strict=True):
        guess[guess] = part
    return guesses, standing is not None


def _pieces_meant(
    points: np.ndarray,
    standing: np.ndarray,
    allowed: np.ndarray,
    boxed: np.ndarray,
    clicked: np.ndarray,
) -> np.ndarray:
    """Returns which points (n,) bool are on a piece of the scene that the marks mean.

    Args:
        points: (n, 3) the points of all views [m, world].
        standing: (n,) bool, which of them form pieces.
        allowed: (n,) bool, which the boxes allow.
        boxed: (n,) bool, which are from a view with a box.
        clicked: (m, 3) points that are clicked on [m, world].
    """
    cells = np.floor(points[standing] / _GAP).astype(int)
    if not len(cells):
        return np.zeros(len(points), dtype=bool)
    cells -= cells.min(axis=0)
    grid = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    grid[tuple(cells.T)] = True
    pieces = ndimage.label(grid, np.ones((3, 3, 3)))[0][tuple(cells.T)]
    meant = np.zeros(pieces.max() + 1, dtype=bool)
    inside, whole = (np.bincount(pieces, of[standing]) for of in (allowed & boxed, boxed))
    meant |= inside > _PIECE_SHARE * whole
    if len(clicked):
        distance, nearest = cKDTree(points[standing]).query(clicked)
        meant[pieces[nearest[distance < _CLICK_REACH]]] = True
    result = np.zeros(len(points), dtype=bool)
    result[standing] = meant[pieces]
    return result


def _grab_cut(view: _View, guess: np.ndarray, allowed: np.ndarray, sure: bool) -> np.ndarray:
    """Returns the foreground (H, W) bool of a view, by OpenCV's GrabCut.

    Args:
        view: The view.
        guess: (H, W) bool; a first guess.
        allowed: (H, W) bool; the foreground is in it.
        sure: Whether the guess is sure but for its border.
    """
    if not guess.any():
        return guess
    v, u = np.nonzero(guess)
    rows = slice(max(v.min() - _CROP_MARGIN, 0), v.max() + _CROP_MARGIN + 1)
    columns = slice(max(u.min() - _CROP_MARGIN, 0), u.max() + _CROP_MARGIN + 1)
    size = 2 * _UNSURE_BORDER + 1
    band = cv2.dilate(guess.astype(np.uint8), np.ones((size, size), np.uint8)).astype(bool)
    seeds = np.full(guess.shape, cv2.GC_BGD, dtype=np.uint8)
    seeds[band & allowed] = cv2.GC_PR_BGD
    seeds[guess] = cv2.GC_PR_FGD
    if sure:
        seeds[erode_mask(guess, _SURE_DEPTH)] = cv2.GC_FGD
    for pixels, kind in ((view.included, cv2.GC_FGD), (view.excluded, cv2.GC_BGD)):
        for pixel in pixels:
            cv2.circle(seeds, pixel.tolist(), _SEED_RADIUS, kind, thickness=-1)
    crop = seeds[rows, columns].copy()
    foreground = np.isin(crop, (cv2.GC_FGD, cv2.GC_PR_FGD))
    if foreground.any() and not foreground.all():
        cv2.setRNGSeed(0)  # The clusters of colours start at random.
        models = np.zeros((1, 65)), np.zeros((1, 65))
        image = np.ascontiguousarray(view.rgb[rows, columns])
        cv2.grabCut(image, crop, None, *models, _GRAB_CUT_ROUNDS, cv2.GC_INIT_WITH_MASK)
    mask = np.zeros(guess.shape, dtype=bool)
    mask[rows, columns] = np.isin(crop, (cv2.GC_FGD, cv2.GC_PR_FGD))
    return mask


def _distance(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Returns the distance (n,) of each point to the nearest of others [m]; infinite if none."""
    if not len(others):
        return np.full(len(points), np.inf)
    return cKDTree(others).query(points)[0]
