"""How the tracks of two runs differ that had the same inputs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.run_log.recorded_run import LoggedTrack
from poil_drake.recording.run_log.series import Series


class TrackPair(NamedTuple):
    """A track of either run, or what both say of the same images.

    Attributes:
        time: When it was logged [s], in the run if that has it.
        both: Whether both runs have it.
        comparable: Whether both have it, and saw a point in common or agree that there is none.
    """

    time: float
    both: bool
    comparable: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackComparison:
    """How the tracks differ.

    Attributes:
        pairs: The tracks of both, in order of the images that they were taken from.
        distances: (T, 1) for each pair of tracks the largest distance of the points that both saw
            [m]; NaN where there is none, infinite where they are not as many.
        points: How many points both have, over all pairs of tracks.
        visibility: How many of them only one of the two saw.
    """

    pairs: Sequence[TrackPair]
    distances: Series
    points: int = 0
    visibility: int = 0

    @property
    def unmatched(self) -> int:
        """How many tracks only one of the two runs has."""
        return sum(not pair.both for pair in self.pairs)


def compare_tracks(
    recorded: Sequence[LoggedTrack], replayed: Sequence[LoggedTrack]
) -> TrackComparison:
    """Compares tracks of the same images: those of the same stamp.

    Args:
        recorded: The tracks of the run.
        replayed: Those of its replay.
    """
    ours = {round(1e9 * logged.track.stamp): logged for logged in recorded}
    others = {round(1e9 * logged.track.stamp): logged for logged in replayed}
    pairs, distances, points, visibility = [], [], 0, 0
    for stamp in sorted(ours.keys() | others.keys()):
        if stamp not in ours or stamp not in others:
            only = ours.get(stamp) or others[stamp]
            pairs.append(TrackPair(only.time, both=False, comparable=False))
            continue
        time, a, b = ours[stamp].time, ours[stamp].track, others[stamp].track
        distance, comparable = _distance(a, b)
        pairs.append(TrackPair(time, both=True, comparable=comparable))
        distances.append((time, [distance]))
        if len(a.positions) == len(b.positions):
            points += len(a.positions)
            visibility += int(np.count_nonzero((a.confidence > 0.0) != (b.confidence > 0.0)))
    return TrackComparison(
        pairs=tuple(pairs),
        distances=Series.of(distances, 1),
        points=points,
        visibility=visibility,
    )


def _distance(a: TrackedPoints, b: TrackedPoints) -> tuple[float, bool]:
    """Returns the largest distance of the common points [m], and if they can be compared."""
    if len(a.positions) != len(b.positions):
        return math.inf, True
    seen = a.confidence > 0.0, b.confidence > 0.0
    distances = np.linalg.norm(a.positions - b.positions, axis=1)[seen[0] & seen[1]]
    if distances.size:
        return float(distances.max()), True
    return math.nan, not (seen[0].any() or seen[1].any())
