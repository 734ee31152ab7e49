"""The perception of a recorded run: its capture and release times, and its tracks."""

from collections.abc import Sequence

import numpy as np

from poil_drake.errors import InvalidValueError, RunLogError
from poil_drake.recording.run_log.layout import (
    DETECTOR_TIMES_TOPIC,
    TRACKER_STATUS_TOPIC,
    TRACKER_TIMES_TOPIC,
)
from poil_drake.recording.run_log.recorded_run import REMEDY, LoggedTrack, RecordedRun, Series
from poil_drake.systems.capture_timing import RecordedTiming
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.recorded_tracker import RecordedTrack

_DECIMALS = 9
"""Decimals to which offsets of captures [control periods] are rounded: logged times are inexact."""


def RecordedTimings(run: RecordedRun, *, period: float) -> tuple[RecordedTiming, RecordedTiming]:
    """Returns the capture and release times of the tracker and the detector in a recorded run.

    Args:
        run: The run.
        period: The control period [s].

    Raises:
        RunLogError: if a result was released before its images were captured.
    """
    captured = [_captured(run, topic) for topic in (TRACKER_TIMES_TOPIC, DETECTOR_TIMES_TOPIC)]
    offset = _offset(captured[0] or captured[1], period)
    return (
        _timing(run, TRACKER_TIMES_TOPIC, captured[0], period, offset),
        _timing(run, DETECTOR_TIMES_TOPIC, captured[1], period, offset),
    )


def _captured(run: RecordedRun, topic: str) -> list[float]:
    times = run.numbers[topic].values[:, 0]
    return np.unique(times[np.isfinite(times)]).tolist()


def _offset(captured: Sequence[float], period: float) -> float:
    """Returns the most frequent time [s] from the start of a control period to a capture in it."""
    if not captured:
        return 0.0
    shares = np.round(np.array(captured) / period % 1.0, _DECIMALS) % 1.0
    values, counts = np.unique(shares, return_counts=True)
    return float(values[np.argmax(counts)] * period)


def _timing(
    run: RecordedRun, topic: str, captured: Sequence[float], period: float, offset: float
) -> RecordedTiming:
    _, released, of = run.numbers[topic].values[:, :3].T
    known = np.isfinite(released) & np.isfinite(of)
    releases = sorted(set(zip(released[known].tolist(), of[known].tolist(), strict=True)))
    try:
        return RecordedTiming(captured=captured, released=releases, period=period, offset=offset)
    except InvalidValueError as error:
        raise RunLogError(f"{run.path}, topic {topic}: {error.problem}", remedy=REMEDY) from error


def RecordedTracks(run: RecordedRun) -> tuple[RecordedTrack, ...]:
    """Returns the tracks that a recorded run released, in order of release."""
    times, statuses = run.numbers[TRACKER_TIMES_TOPIC], run.numbers[TRACKER_STATUS_TOPIC]
    found = []
    for logged in run.tracks:
        _, released, captured, number = times.at(logged.time).tolist()
        if np.isfinite(released):
            found.append(
                RecordedTrack(
                    captured=captured,
                    released=released,
                    points=logged.track,
                    status=_status(logged, number, statuses),
                )
            )
    return tuple(sorted(found, key=lambda track: track.released))


def _status(logged: LoggedTrack, number: float, statuses: Series) -> TrackerStatus:
    """Returns the tracker's status for a track, inferred from the track if none was logged.

    Args:
        logged: The track.
        number: The status logged with the track's times; NaN in logs of older versions.
        statuses: The periodically logged statuses. The first one after the track is used if
            `number` is NaN.
    """
    later = int(np.searchsorted(statuses.times, logged.time))
    next_number = statuses.values[later, 0] if later < len(statuses) else np.nan
    for found in (number, next_number):
        if found in set(TrackerStatus):
            return TrackerStatus(int(found))
    seen = bool(np.any(logged.track.confidence > 0.0))
    return TrackerStatus.TRACKING if seen else TrackerStatus.LOST
