from pathlib import Path

import numpy as np
import pytest

from poil_drake.diagrams.station.replay_station import RecordedTimings, RecordedTracks
from poil_drake.errors import RunLogError
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.run_log.recorded_run import LoggedTrack, RecordedRun
from poil_drake.recording.run_log.series import Series
from poil_drake.systems.statuses import TrackerStatus

NAN = np.nan


def make_run(*, statuses=((0.25, 1.0), (0.5, 2.0)), said=(NAN, NAN), early=0.0):
    times = [
        # Time of logging, begun, released, released_of, status
        (0.01, [0.0, NAN, NAN, 0.0]),
        (0.13, [0.125, NAN, NAN, 0.0]),
        (0.2, [0.125, 0.1875, 0.0, said[0]]),
        (0.26, [0.25, 0.1875, 0.0, said[0]]),
        (0.44, [0.25, 0.4375 - early, 0.25, said[1]]),
    ]
    tracks = [
        LoggedTrack(0.2, TrackedPoints(np.eye(3), np.ones(3), 0.0)),
        LoggedTrack(0.44, TrackedPoints.lost(3, 0.25)),
    ]
    return RecordedRun(
        Path("run.mcap"),
        (),
        numbers={
            "/tracker/times": Series.of(times, 4),
            "/detector/times": Series.of([(0.1, [0.0625, 0.0625, 0.0625])], 3),
            "/tracker/status": Series.of([(time, [status]) for time, status in statuses], 1),
        },
        tracks=tracks,
    )


def test_the_schedules_are_those_of_the_log():
    tracker, detector = RecordedTimings(make_run(), period=1 / 256)

    assert list(tracker.captured) == [0.0, 0.125, 0.25]
    # What was captured at 0.125 s was never released.
    assert list(tracker.released) == [(0.1875, 0.0), (0.4375, 0.25)]
    assert list(detector.captured) == [0.0625]
    assert list(detector.released) == [(0.0625, 0.0625)]


def test_tracks_are_repeated_with_their_times_and_statuses():
    tracks = RecordedTracks(make_run())

    assert [(t.captured, t.released, t.status) for t in tracks] == [
        (0.0, 0.1875, TrackerStatus.TRACKING),
        (0.25, 0.4375, TrackerStatus.LOST),
    ]


def test_a_status_logged_with_the_track_takes_precedence():
    run = make_run(said=(TrackerStatus.LOST, TrackerStatus.TRACKING))

    tracks = RecordedTracks(run)

    assert [t.status for t in tracks] == [TrackerStatus.LOST, TrackerStatus.TRACKING]


def test_impossible_times_are_reported_with_their_topic():
    with pytest.raises(RunLogError, match=r"run.mcap, topic /tracker/times: .* precedes its"):
        RecordedTimings(make_run(early=0.2), period=1 / 256)


@pytest.mark.parametrize("statuses", [(), ((0.25, NAN), (0.5, NAN)), ((0.25, 9.0), (0.5, -1.0))])
def test_unknown_statuses_follow_from_the_tracks(statuses):
    tracks = RecordedTracks(make_run(statuses=statuses))

    assert [t.status for t in tracks] == [TrackerStatus.TRACKING, TrackerStatus.LOST]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.875])
@pytest.mark.parametrize("period", [1 / 256, 0.005])
def test_captures_keep_their_offset_within_the_period(share, period):
    begun = [(k + share) * period for k in (3, 36, 70, 103)]
    run = make_run()
    run.numbers["/tracker/times"] = Series.of([(t, [t, NAN, NAN, NAN]) for t in begun], 4)

    for timing in RecordedTimings(run, period=period):
        assert timing.offset == share * period


def test_without_captures_the_offset_is_zero():
    run = make_run()
    run.numbers |= {topic: Series.of([], 4) for topic in ("/tracker/times", "/detector/times")}

    assert RecordedTimings(run, period=1 / 256)[0].offset == 0.0
