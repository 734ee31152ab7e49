"""Compares the tracks of a run with those of its replay."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.run_log.recorded_run import LoggedTrack
from poil_drake.recording.run_log.series import Series


class TrackPair(NamedTuple):
    """Two tracks from the same images: one of the recorded run, the other of the replay.

    Attributes:
        time: When the track was logged [s]: in the recorded run, or, if that lacks the track, in
            the replay.
        comparable: False if only one run has the track, or if the runs saw points, but none in
            common.
    """

    time: float
    comparable: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackComparison:
    """How the tracks of a run and of its replay differ.

    Attributes:
        pairs: The tracks of both runs, in the order of their images.
        distances: For each of the T tracks that both runs have, (T, 1) the largest distance [m]
            between corresponding points that both runs saw. NaN if the runs saw no point in common;
            infinite if the numbers of points differ.
        unmatched: Number of tracks that only one of the two runs has.
        points: Number of points in the tracks with the same number of points in both runs.
        visibility: How many of `points` only one of the two runs saw.
    """

    pairs: Sequence[TrackPair]
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
        pairs.append(TrackPair(time, comparable))
    return TrackComparison(
        pairs=pairs,
        distances=Series.of(distances, 1),
        unmatched=len(run.keys() ^ replay.keys()),
        points=points,
        visibility=visibility,
    )


def _distance(a: TrackedPoints, b: TrackedPoints) -> tuple[float, bool]:
    """Returns the distance in `TrackComparison.distances`, and `TrackPair.comparable`."""
    if len(a.positions) != len(b.positions):
        return math.inf, True
    seen = a.confidence > 0.0, b.confidence > 0.0
    distances = np.linalg.norm(a.positions - b.positions, axis=1)[seen[0] & seen[1]]
    if distances.size:
        return float(distances.max()), True
    return math.nan, not (seen[0].any() or seen[1].any())
