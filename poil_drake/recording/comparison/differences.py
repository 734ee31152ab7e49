"""Differences between two runs' samples of a signal, and between their tracks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.run_log.recorded_run import ROUNDING, LoggedTrack, Series


class SignalPair(NamedTuple):
    """The samples of a signal in two runs, at the times that both runs have.

    Attributes:
        times: (T,) sample times [s], sorted.
        a: (T, n) values of the signal in the first run.
        b: (T, n) values of the signal in the second run.
    """

    times: np.ndarray
    a: np.ndarray
    b: np.ndarray

    @classmethod
    def of(cls, a: Series, b: Series) -> Self:
        """Returns the samples of two series at the times that both have."""
        in_ns = [np.rint(1e9 * series.times).astype(np.int64) for series in (a, b)]
        _, in_a, in_b = np.intersect1d(in_ns[0], in_ns[1], return_indices=True)
        return cls(a.times[in_a], a.values[in_a], b.values[in_b])

    def differences(self, shift: float = 0.0) -> np.ndarray:
        """Returns the (T, n) absolute differences.

        They are zero where neither value is finite, and infinite where only one value is finite.

        Args:
            shift: Time by which either run may be earlier or later [s]. Each value is compared with
                the range of the other run's values within `shift` of its time. Of the two distances
                at a time, the difference is the larger one.
        """
        known = np.isfinite(self.a), np.isfinite(self.b)
        both = known[0] & known[1]
        found = np.zeros(self.a.shape)
        for one, other, finite in ((self.a, self.b, known[1]), (self.b, self.a, known[0])):
            lowest, highest = self._bounds(other, finite, shift)
            value = np.where(both, one, 0.0)
            found = np.maximum(found, np.maximum(value - highest, lowest - value))
        return np.where(both, found, np.where(known[0] != known[1], np.inf, 0.0))

    def _bounds(
        self, values: np.ndarray, finite: np.ndarray, shift: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns (T, n) minima and maxima of `values`, where `finite`, up to `shift` [s] away."""
        reach = shift + ROUNDING
        first = np.searchsorted(self.times, self.times - reach)
        last = np.searchsorted(self.times, self.times + reach, side="right")
        # `reduceat` reduces from each index to the next; every other result is that of a window. A
        # neutral last row makes the end of the last window a valid index.
        windows = np.column_stack([first, last]).ravel()
        padded = [
            np.vstack([np.where(finite, values, unknown), np.full((1, values.shape[1]), unknown)])
            for unknown in (np.inf, -np.inf)
        ]
        return (
            np.minimum.reduceat(padded[0], windows)[::2],
            np.maximum.reduceat(padded[1], windows)[::2],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackComparison:
    """How the tracks of a run and of its replay differ.

    Attributes:
        pairs: The tracks of both runs, in the order of their images: when each was logged [s], in
            the recorded run or, if that lacks the track, in the replay; and whether it can be
            compared: not if only one run has it, or the runs saw points, but none in common.
        distances: For each of the T tracks that both runs have, (T, 1) the largest distance [m]
            between corresponding points that both runs saw. NaN if the runs saw no point in common;
            infinite if the numbers of points differ.
        unmatched: Number of tracks that only one of the two runs has.
        points: Number of points in the tracks with the same number of points in both runs.
        visibility: How many of `points` only one of the two runs saw.
    """

    pairs: Sequence[tuple[float, bool]]
    distances: Series
    unmatched: int
    points: int
    visibility: int


def compare_tracks(
    recorded: Sequence[LoggedTrack], replayed: Sequence[LoggedTrack]
) -> TrackComparison:
    """Compares the tracks that have the same stamp, and so come from the same images.

    Args:
        recorded: The tracks of the run.
        replayed: The tracks of its replay.
    """
    run, replay = (
        {round(1e9 * logged.track.stamp): logged for logged in tracks}
        for tracks in (recorded, replayed)
    )
    pairs, distances, points, visibility = [], [], 0, 0
    for stamp in sorted(run.keys() | replay.keys()):
        time, comparable = (run.get(stamp) or replay[stamp]).time, False
        if stamp in run and stamp in replay:
            a, b = run[stamp].track, replay[stamp].track
            distance, comparable = _distance(a, b)
            distances.append((time, [distance]))
            if len(a.positions) == len(b.positions):
                points += len(a.positions)
                visibility += int(np.count_nonzero((a.confidence > 0.0) != (b.confidence > 0.0)))
        pairs.append((time, comparable))
    return TrackComparison(
        pairs=pairs,
        distances=Series.of(distances, 1),
        unmatched=len(run.keys() ^ replay.keys()),
        points=points,
        visibility=visibility,
    )


def _distance(a: TrackedPoints, b: TrackedPoints) -> tuple[float, bool]:
    """Returns the distance in `TrackComparison.distances`, and whether it can be compared."""
    if len(a.positions) != len(b.positions):
        return math.inf, True
    seen = a.confidence > 0.0, b.confidence > 0.0
    distances = np.linalg.norm(a.positions - b.positions, axis=1)[seen[0] & seen[1]]
    if distances.size:
        return float(distances.max()), True
    return math.nan, not (seen[0].any() or seen[1].any())
