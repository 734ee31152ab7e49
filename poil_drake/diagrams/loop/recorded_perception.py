"""When a run's perception looked and answered, and what it said, as the run's log has it."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError, RunLogError
from poil_drake.recording.run_log.layout import (
    DETECTOR_TIMES_TOPIC,
    TRACKER_STATUS_TOPIC,
    TRACKER_TIMES_TOPIC,
)
from poil_drake.recording.run_log.recorded_run import REMEDY, LoggedTrack, RecordedRun
from poil_drake.recording.run_log.series import Series
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.recorded_schedule import RecordedSchedule
from poil_drake.systems.tracking.recorded_tracker import RecordedTrack

_DECIMALS = 9
"""Of a share of the control period: what is left of it when times are rounded."""


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

    def offset(self, period: float) -> float:
        """Returns how long after the beginning of a control period frames were captured [s].

        Args:
            period: The control period [s].
        """
        captures = self.tracking.captures or self.detection.captures
        if not len(captures):
            return 0.0
        shares = np.round(np.array(captures) / period % 1.0, _DECIMALS) % 1.0
        values, counts = np.unique(shares, return_counts=True)
        return float(values[np.argmax(counts)] * period)


def PerceptionOf(run: RecordedRun, *, repeat_tracks: bool) -> RecordedPerception:
    """Returns the perception of a recorded run.

    Args:
        run: The run.
        repeat_tracks: Whether its tracks are repeated, rather than made anew from its images.

    Raises:
        RunLogError: if something was released before it was captured.
    """
    return RecordedPerception(
        tracking=_schedule(run, TRACKER_TIMES_TOPIC),
        detection=_schedule(run, DETECTOR_TIMES_TOPIC),
        tracks=_tracks(run) if repeat_tracks else None,
    )


def _schedule(run: RecordedRun, topic: str) -> RecordedSchedule:
    begun, released, of = run.numbers[topic].values[:, :3].T
    captures = np.unique(begun[np.isfinite(begun)]).tolist()
    known = np.isfinite(released) & np.isfinite(of)
    releases = sorted(set(zip(released[known].tolist(), of[known].tolist(), strict=True)))
    try:
        return RecordedSchedule.of(captures, releases)
    except InvalidValueError as error:
        raise RunLogError(f"{run.path}, topic {topic}: {error.problem}", remedy=REMEDY) from error


def _tracks(run: RecordedRun) -> tuple[RecordedTrack, ...]:
    times, statuses = run.numbers[TRACKER_TIMES_TOPIC], run.numbers[TRACKER_STATUS_TOPIC]
    found = []
    for logged in run.tracks:
        _, released, captured, number = times.at(logged.time).tolist()
        if np.isfinite(released):
            found.append(
                RecordedTrack(
                    captured=captured,
                    released=released,
                    track=logged.track,
                    status=_status(logged, number, statuses),
                )
            )
    return tuple(sorted(found, key=lambda track: track.released))


def _status(logged: LoggedTrack, number: float, statuses: Series) -> TrackerStatus:
    """Returns what the tracker thought of a track.

    Args:
        logged: The track.
        number: What was logged with its times; NaN in logs of older versions.
        statuses: What was logged every now and then, of which the next is looked at.
    """
    later = int(np.searchsorted(statuses.times, logged.time))
    next_number = statuses.values[later, 0] if later < len(statuses) else np.nan
    for found in (number, next_number):
        if found in set(TrackerStatus):
            return TrackerStatus(int(found))
    seen = bool(np.any(logged.track.confidence > 0.0))
    return TrackerStatus.TRACKING if seen else TrackerStatus.LOST
