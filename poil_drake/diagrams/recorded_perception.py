"""When a run's perception looked and answered, and what it said, as the run's log has it."""

from dataclasses import dataclass

import numpy as np

from poil_drake.recording.recorded_run import LoggedTrack, RecordedRun
from poil_drake.recording.run_log_layout import (
    DETECTOR_TIMES_TOPIC,
    TRACKER_STATUS_TOPIC,
    TRACKER_TIMES_TOPIC,
)
from poil_drake.recording.series import Series
from poil_drake.systems.recorded_schedule import RecordedSchedule
from poil_drake.systems.recorded_tracker import RecordedTrack
from poil_drake.systems.statuses import TrackerStatus


@dataclass(frozen=True, kw_only=True)
class RecordedPerception:
    """What a replay repeats of the perception of a run.

    Attributes:
        tracking: When the tracker captured frames, and released their tracks.
        detection: When searches for the part were begun, and their results taken.
        tracks: What the tracker said, where no tracker is to see the images again; else None.
    """

    tracking: RecordedSchedule
    detection: RecordedSchedule
    tracks: tuple[RecordedTrack, ...] | None = None


def PerceptionOf(run: RecordedRun, *, repeat_tracks: bool) -> RecordedPerception:
    """Returns the perception of a recorded run.

    Args:
        run: The run.
        repeat_tracks: Whether its tracks are repeated, rather than made anew from its images.
    """
    return RecordedPerception(
        tracking=_schedule(run.numbers[TRACKER_TIMES_TOPIC]),
        detection=_schedule(run.numbers[DETECTOR_TIMES_TOPIC]),
        tracks=_tracks(run) if repeat_tracks else None,
    )


def _schedule(times: Series) -> RecordedSchedule:
    begun, released, of = times.values.T if len(times) else np.empty((3, 0))
    captures = np.unique(begun[np.isfinite(begun)]).tolist()
    known = np.isfinite(released) & np.isfinite(of)
    releases = sorted(set(zip(released[known].tolist(), of[known].tolist(), strict=True)))
    return RecordedSchedule.of(captures, releases)


def _tracks(run: RecordedRun) -> tuple[RecordedTrack, ...]:
    times, statuses = run.numbers[TRACKER_TIMES_TOPIC], run.numbers[TRACKER_STATUS_TOPIC]
    found = []
    for logged in run.tracks:
        _, released, captured = times.at(logged.time).tolist()
        if np.isfinite(released):
            found.append(
                RecordedTrack(
                    captured=captured,
                    released=released,
                    track=logged.track,
                    status=_status(logged, statuses),
                )
            )
    return tuple(sorted(found, key=lambda track: track.released))


def _status(logged: LoggedTrack, statuses: Series) -> TrackerStatus:
    """Returns what the tracker thought of a track: what was logged with it, or next."""
    later = int(np.searchsorted(statuses.times, logged.time))
    if later < len(statuses):
        number = statuses.values[later, 0]
        if number in set(TrackerStatus):
            return TrackerStatus(int(number))
    seen = bool(np.any(logged.track.confidence > 0.0))
    return TrackerStatus.TRACKING if seen else TrackerStatus.LOST
