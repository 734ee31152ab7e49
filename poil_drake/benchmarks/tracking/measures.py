"""What the benchmark measures of a track: pure functions of what was reported and what was true."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WRONG = 0.03
"""Mean error of the reported points from which on a track is wrong, and must be noticed [m]."""

RECOVERED = 0.01
"""Mean error up to which an object is found again [m]."""

HIDDEN, VISIBLE = 0.02, 0.25
"""Share of the object's first pixels, in the best view, below which the object is hidden, and from
which on a tracker has no reason to lose it."""

DOUBTED = 0.25
"""Confidence of the best point below which the points that a tracker reports are a guess."""

RECOVERY_LIMIT = 1.0
"""Time after a disturbance within which an object should be found again [s]."""

NOTICE_LIMIT = 0.3
"""Time within which a loss should be noticed [s]."""


@dataclass(frozen=True, eq=False)
class Track:
    """What a tracker reported for the T frames it was given.

    Attributes:
        times: (T,) [s].
        errors: (T, N) distance of each reported point from the true one [m]; NaN: not reported.
        lost: (T,) bool, whether the tracker said that it has lost the object.
        confidence: (T,) largest confidence of a point; 0 where the object is lost.
        visible: (T,) share of the object's first pixels in the view that shows most of it.
        wall: (T,) time that each frame took [s].
        disturbance: When a disturbance begins and ends [s]; None if there is none that ends.
    """

    times: np.ndarray
    errors: np.ndarray
    lost: np.ndarray
    confidence: np.ndarray
    visible: np.ndarray
    wall: np.ndarray
    disturbance: tuple[float, float] | None = None

    @property
    def mean_errors(self) -> np.ndarray:
        """(T,) mean error of the reported points [m]; NaN where none was reported."""
        reported = np.isfinite(self.errors)
        count = reported.sum(axis=1)
        total = np.where(reported, self.errors, 0.0).sum(axis=1)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def notice_times(track: Track) -> tuple[list[float], list[float]]:
    """Returns how long it took to notice that the object was hidden, and that a track was wrong.

    An object is hidden while no view shows it; noticed when the tracker says that it is lost, or
    has less confidence than `DOUBTED` in every point. A track is wrong while its mean error exceeds
    `WRONG`; that ends when the tracker says that the object is lost, or the track is right again.
    What ends before it is noticed, within `NOTICE_LIMIT`, is no loss; what is not noticed until it
    ends takes infinitely long.
    """
    wrong = np.nan_to_num(track.mean_errors) > WRONG
    hidden_times = []
    for first, last in _runs(track.visible < HIDDEN):
        doubted = track.lost | (track.confidence < DOUBTED)
        noticed = np.flatnonzero(doubted[first : last + 1])
        length = track.times[last] - track.times[first]
        if noticed.size:
            hidden_times.append(float(track.times[first + noticed[0]] - track.times[first]))
        elif length > NOTICE_LIMIT:
            hidden_times.append(np.inf)
    end = len(track.times) - 1
    wrong_times = []
    for first, last in _runs(wrong & ~track.lost):
        if last < end or track.times[last] - track.times[first] > NOTICE_LIMIT:
            # In the frame after the last wrong one, the tracker says so, or is right again.
            noticed_at = track.times[last + 1] if last < end else np.inf
            wrong_times.append(float(noticed_at - track.times[first]))
    return hidden_times, wrong_times


def recovery_time(track: Track) -> float:
    """Returns the time from a disturbance's end until the track is right again [s].

    Infinite if it never is; NaN without a disturbance.
    """
    if track.disturbance is None:
        return np.nan
    after = track.times >= track.disturbance[1]
    right = after & ~track.lost & (np.nan_to_num(track.mean_errors, nan=np.inf) <= RECOVERED)
    if not right.any():
        return np.inf
    return float(track.times[np.argmax(right)] - track.times[np.argmax(after)])


def false_alarms(track: Track) -> tuple[int, int]:
    """Returns in how many frames the tracker said wrongly that the object is lost, of how many.

    Counted are frames that show the object, except from the begin of a disturbance to the end of
    the time to recover from it. A loss that began in another frame is no false alarm, however long
    it lasts.
    """
    counted = track.visible >= VISIBLE
    if track.disturbance is not None:
        start, end = track.disturbance
        counted &= (track.times < start) | (track.times > end + RECOVERY_LIMIT)
    alarms = np.zeros(len(counted), dtype=bool)
    for first, last in _runs(track.lost):
        alarms[first : last + 1] = counted[first]
    return int(np.count_nonzero(alarms & counted)), int(np.count_nonzero(counted))


def summarize(tracks: Sequence[Track]) -> dict[str, float | int]:
    """Returns the figures of one tracker in one case over all trials, by name.

    Errors are in metres and times in seconds. A share is NaN where there was nothing to count.
    """
    errors = np.concatenate([t.errors[np.isfinite(t.errors)] for t in tracks] or [np.zeros(0)])
    wall = np.concatenate([t.wall for t in tracks] or [np.zeros(0)])
    hidden, wrong = (
        np.array([x for times in column for x in times])
        for column in zip(*(notice_times(t) for t in tracks), strict=True)
    )
    recovered = np.array([recovery_time(t) for t in tracks])
    recovered = recovered[~np.isnan(recovered)]
    alarms, counted = np.sum([false_alarms(t) for t in tracks], axis=0)
    return {
        "trials": len(tracks),
        "frames": len(wall),
        "error_median": _percentile(errors, 50),
        "error_p95": _percentile(errors, 95),
        "hidden": len(hidden),
        "hidden_noticed": _share(hidden <= NOTICE_LIMIT),
        "hidden_notice_median": _percentile(hidden, 50),
        "wrong": len(wrong),
        "wrong_noticed": _share(wrong <= NOTICE_LIMIT),
        "wrong_longest": _percentile(wrong, 100),
        "recovered": _share(recovered <= RECOVERY_LIMIT),
        "recovery_median": _percentile(recovered, 50),
        "recovery_longest": _percentile(recovered, 100),
        "false_alarms": float(alarms / counted) if counted else np.nan,
        "frames_per_second": 1.0 / float(np.mean(wall)) if wall.size else np.nan,
    }


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Returns the first and last index of each run of True in a mask (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]


def _percentile(values: np.ndarray, percent: float) -> float:
    """Returns a percentile, an actual value so that infinite ones do not mix; NaN of nothing."""
    return float(np.percentile(values, percent, method="higher")) if values.size else np.nan


def _share(holds: np.ndarray) -> float:
    return float(np.mean(holds)) if holds.size else np.nan
