"""Masks of what boxes and clicks mark in several views, by depth, colour and the other views."""

from collections.abc import Sequence

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from poil_drake.geometry.depth_image import erode_mask
from poil_drake.perception.detectors.by_hand.hand_labels import HandLabels
from poil_drake.perception.detectors.by_hand.role_marks import (
    CLICK_REACH,
    MarkedView,
    RoleMarks,
    distance_to,
)
from poil_drake.perception.detectors.by_hand.support_plane import off_support
from poil_drake.perception.images import MultiViewFrame

_SCENE_REACH = 0.6  # [m] from the marks; what is farther away is not part of what they mark
_GAP = 0.01  # [m] Surfaces that are nearer to each other than this, or twice this, are one piece.
_PIECE_SHARE = 0.5  # Least share of a piece's pixels in the boxes if the boxes mean the piece.
_PIECE_DISTANCE = 0.015  # [m] A click beside a thin piece, this near, is on the piece.
_CARRIED_REACH = 0.01  # [m] How far the part in the marked views reaches in the others.
_SURE_DEPTH = 1  # [px] from the border of the first guess: surely foreground
_UNSURE_BORDER = 3  # [px] outside of the first guess, in which the outline may be
_SEED_RADIUS = 3  # [px] of the disc around a click that surely belongs to its side
_CROP_MARGIN = 20  # [px] Width of the background whose colours count.
_GRAB_CUT_ROUNDS = 3


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
    marks = RoleMarks.of(frame, labels, role)
    guesses, sure = _first_guesses(marks)
    return tuple(
        _grab_cut(view, guess, allowed, sure) & allowed
        for view, guess, allowed in zip(marks.views, guesses, marks.allowed, strict=True)
    )


def part_masks(
    frame: MultiViewFrame, labels: HandLabels, role: str, objects: Sequence[np.ndarray]
) -> tuple[np.ndarray, ...]:
    """Returns the mask (H, W) bool of a part of an object in each view.

    The part is what the boxes of all views enclose of the object, and what is nearer, along the
    surface, to a click on the part than to a click on the rest. Without a box, a click on the part
    reaches `CLICK_REACH` far. Colour does not count, since a part often has that of its object.

    Args:
        frame: The views.
        labels: The marks; see `HandLabels`.
        role: The part's role in the marks.
        objects: The object's mask (H, W) bool in each view.
    """
    marks = RoleMarks.of(frame, labels, role)
    masks = [mask & allowed for mask, allowed in zip(objects, marks.allowed, strict=True)]
    views = list(zip(marks.views, masks, strict=True))
    for view, mask in views:
        reach = np.inf if marks.boxed else CLICK_REACH
        mask[mask] = marks.not_excluded(view.points[mask], reach)
    seen = [np.zeros((0, 3)), *(view.points[mask] for view, mask in views if view.marked)]
    for view, mask in views:
        if not view.marked:
            mask[mask] = distance_to(view.points[mask], np.concatenate(seen)) < _CARRIED_REACH
    return tuple(masks)


def _first_guesses(marks: RoleMarks) -> tuple[list[np.ndarray], bool]:
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
    among = ~allowed if marks.boxed else np.ones(len(points), dtype=bool)
    standing = off_support(points, around=centre, among=among)
    near = np.linalg.norm(points - centre, axis=1) < _SCENE_REACH
    chosen = allowed & near
    if standing is not None:
        chosen &= standing
        meant = _pieces_meant(points, standing & near, allowed, boxed, marks.included)
        if meant.any():
            chosen &= meant
    chosen[chosen] = marks.not_excluded(points[chosen])
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
        meant[pieces[nearest[distance < _PIECE_DISTANCE]]] = True
    result = np.zeros(len(points), dtype=bool)
    result[standing] = meant[pieces]
    return result


def _grab_cut(view: MarkedView, guess: np.ndarray, allowed: np.ndarray, sure: bool) -> np.ndarray:
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
