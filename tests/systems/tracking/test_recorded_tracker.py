import numpy as np
from system_bench import SystemBench

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.recorded_tracker import RecordedTrack, RecordedTracker

PERIOD = 1 / 16


def make_track(captured, released, status=TrackerStatus.TRACKING):
    track = TrackedPoints(captured + np.eye(3), np.ones(3), captured)
    return RecordedTrack(captured=captured, released=released, points=track, status=status)


def make_bench(*tracks):
    return SystemBench(RecordedTracker(tracks=tracks, num_points=3, period=PERIOD))


def test_tracks_are_released_at_their_recorded_times():
    bench = make_bench(make_track(0.0, 0.1875), make_track(0.125, 0.3, TrackerStatus.LOST))
    seen = []
    for tick in range(8):
        # After the updates of the tick.
        bench.advance_to(tick * PERIOD + 1 / 64)
        status = TrackerStatus(int(bench.read("status")[0]))
        seen.append((tick * PERIOD, bench.read("tracked_points").stamp, status.name))

    assert seen == [
        *((tick * PERIOD, -np.inf, "WAITING") for tick in range(3)),
        (0.1875, 0.0, "TRACKING"),
        (0.25, 0.0, "TRACKING"),
        # The first tick after 0.3 s.
        (0.3125, 0.125, "LOST"),
        (0.375, 0.125, "LOST"),
        (0.4375, 0.125, "LOST"),
    ]


def test_the_times_are_those_of_the_last_release():
    bench = make_bench(make_track(0.0, 0.125))
    np.testing.assert_array_equal(bench.read("times"), np.full(3, -np.inf))

    bench.advance_to(0.25)

    np.testing.assert_array_equal(bench.read("times"), [0.0, 0.125, 0.0])


def test_without_tracks_the_points_are_lost():
    bench = make_bench()

    bench.advance_to(0.25)

    assert bench.read("tracked_points").confidence.tolist() == [0.0, 0.0, 0.0]
