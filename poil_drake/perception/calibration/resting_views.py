"""Chooses the frames of a recording in which a calibration board rests."""

from collections.abc import Iterable

import numpy as np

from poil_drake.perception.calibration.board import CalibrationBoard
from poil_drake.perception.calibration.view_folder import View
from poil_drake.perception.images import MultiViewFrame

_STILL = 0.5
"""Largest median motion of a resting board's corners between two frames [px]. A faster board looks
different to cameras that do not capture at the same instant."""

_Corners = dict[str, tuple[np.ndarray, np.ndarray] | None]


def resting_views(frames: Iterable[MultiViewFrame], board: CalibrationBoard) -> list[View]:
    """Returns one view for each time that the board rests for at least two frames."""
    views: list[View] = []
    before: _Corners = {}
    rested = False
    for frame in frames:
        images = {c.name: i.rgb for c, i in zip(frame.cameras, frame.images, strict=True)}
        corners = {name: board.detect(image) for name, image in images.items()}
        rests = _rests(before, corners)
        if rests and not rested:
            views.append(View(f"{len(views):02d}", images))
        before, rested = corners, rests
    return views


def _rests(before: _Corners, after: _Corners) -> bool:
    """Returns whether a camera sees the board in both frames, and no camera sees it move."""
    motions = []
    for name, now in after.items():
        last = before.get(name)
        if now is None or last is None:
            continue
        _, here, there = np.intersect1d(now[0], last[0], return_indices=True)
        if len(here):
            motions.append(np.median(np.linalg.norm(now[1][here] - last[1][there], axis=1)))
    return bool(motions) and max(motions) <= _STILL
