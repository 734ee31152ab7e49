"""When the point tracker captures, and what it reports."""

import numpy as np
import pytest
from point_tracker_bench import (
    AFTER,
    MASKS,
    PERIOD,
    QUERY,
    MakeBench,
    N,
    Scene,
    SummingTracker,
)

from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.capture_timing import RecordedTiming, SimulatedDelay
from poil_drake.systems.statuses import TrackerStatus


def test_points_are_those_of_the_tracker_fed_by_hand(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=1 / 16))

    bench.advance_to(2 * PERIOD + 1 / 16 + AFTER)

    # Depth is 1 + t, and each prior is 1/8 m along x.
    first = np.sin(QUERY) + np.float32(1 + PERIOD) + PERIOD
    second = np.sin(first) + np.float32(1 + 2 * PERIOD) + PERIOD
    np.testing.assert_allclose(bench.points.positions, second, atol=1e-12)


def test_the_frame_is_that_of_the_last_capture(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=1 / 16))

    bench.advance_to(PERIOD + AFTER)

    assert bench.read("frame") is not None
    assert bench.read("frame").stamp == PERIOD
    assert bench.read("frame").images[0].depth[0, 0] == np.float32(1 + PERIOD)
    assert bench.points.stamp == 0.0


def test_a_motion_that_is_no_number_is_no_prior(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=0.0), moving=np.nan)

    bench.advance_to(PERIOD + AFTER)

    expected = np.sin(QUERY) + np.float32(1 + PERIOD)
    np.testing.assert_allclose(bench.points.positions, expected, atol=1e-12)


def test_it_waits_for_the_detector(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=0.0), masks=ABSENT)
    bench.advance_to(PERIOD + AFTER)
    assert bench.read("status") == TrackerStatus.WAITING
    assert np.all(bench.points.confidence == 0.0)
    bench.fix(masks=MASKS)

    bench.advance_to(2 * PERIOD + AFTER)

    assert bench.read("status") == TrackerStatus.TRACKING
    np.testing.assert_array_equal(bench.points.positions, QUERY)


def test_query_points_may_come_through_the_port(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=0.0), query_points=None)
    bench.fix(query_points=np.full(3 * N, np.nan))
    bench.advance_to(AFTER)
    assert bench.read("status") == TrackerStatus.WAITING
    bench.fix(query_points=QUERY)

    bench.advance_to(PERIOD + AFTER)

    np.testing.assert_array_equal(bench.points.positions, QUERY)


def test_a_loss_passes_through(make_bench: MakeBench) -> None:
    tracker = SummingTracker()
    tracker.lost_at = frozenset({PERIOD})
    bench = make_bench(timing=SimulatedDelay(latency=1 / 16), tracker=tracker)

    bench.advance_to(PERIOD + 1 / 16 + AFTER)
    status, points = bench.read("status"), bench.points
    bench.advance_to(2 * PERIOD + 1 / 16 + AFTER)

    assert status == TrackerStatus.LOST
    assert points.stamp == PERIOD
    np.testing.assert_array_equal(points.confidence, np.zeros(N))
    assert bench.read("status") == TrackerStatus.TRACKING


def test_a_trackers_own_error_ends_the_simulation(make_bench: MakeBench) -> None:
    tracker = SummingTracker()
    tracker.step = lambda state, frame, prior: 1 / 0
    bench = make_bench(tracker=tracker)

    with pytest.raises(ZeroDivisionError):
        bench.advance_to(1.0)


def test_two_contexts_of_one_tracker_do_not_mix(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=1 / 16))
    bench.advance_to(0.5)
    first = bench.points.positions
    context = bench.simulator.get_mutable_context()
    context.SetTime(0.0)
    bench.simulator.get_system().SetDefaultContext(context)
    bench.simulator.Initialize()
    assert bench.read("status") == TrackerStatus.WAITING

    bench.advance_to(0.5)

    np.testing.assert_array_equal(bench.points.positions, first)


def test_before_the_first_event_nothing_is_tracked(make_bench: MakeBench) -> None:
    bench = make_bench()

    assert bench.read("status") == TrackerStatus.WAITING
    assert bench.points.stamp == -np.inf
    np.testing.assert_array_equal(bench.points.confidence, np.zeros(N))
    assert bench.read("frame") is ABSENT


def test_images_are_read_once_per_capture(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=1 / 16))

    for time in np.arange(AFTER, 0.5, 1 / 64):
        bench.advance_to(time)

    assert bench.scene.looks == [0.0, 0.125, 0.25, 0.375]


def test_a_frozen_camera_is_not_tracked(make_bench: MakeBench) -> None:
    bench = make_bench(
        timing=SimulatedDelay(latency=0.0), scene=Scene(frozen_from=0.25), with_stamps=True
    )

    bench.advance_to(1.0)

    assert bench.points.stamp == 0.25


def test_a_stopwatch_counts_the_work(make_bench: MakeBench) -> None:
    stopwatch = Stopwatch()
    bench = make_bench(timing=SimulatedDelay(latency=0.0), stopwatch=stopwatch)

    bench.advance_to(0.3)

    assert stopwatch.durations("tracking").shape == (3,)


def test_images_may_be_checked_for_more_often_than_they_are_tracked(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(period=1 / 64, latency=0.0)
    bench = make_bench(timing=timing, min_interval=0.1, with_stamps=True)

    bench.advance_to(0.5)

    # Each time, the first check at which the image is 0.1 s newer than the one before.
    assert bench.scene.looks == [0.0, 7 / 64, 14 / 64, 21 / 64, 28 / 64]


def test_points_may_be_searched_only_until_they_are_found(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(latency=0.0)
    bench = make_bench(timing=timing, once=True, masks=ABSENT, with_stamps=True)
    bench.advance_to(2 * PERIOD + AFTER)
    assert bench.read("status") == TrackerStatus.WAITING
    bench.fix(masks=MASKS)

    bench.advance_to(8 * PERIOD)

    assert bench.read("status") == TrackerStatus.TRACKING
    assert bench.points.stamp == 3 * PERIOD
    assert bench.scene.looks == [0.0, PERIOD, 2 * PERIOD, 3 * PERIOD]


def test_a_replay_skips_what_its_log_lacks(make_bench: MakeBench) -> None:
    timing = RecordedTiming(
        captured=(0.125, 0.25), released=((0.1875, 0), (0.3125, 1)), period=1 / 64
    )
    bench = make_bench(timing=timing, scene=Scene(frozen_from=0.125), with_stamps=True)

    bench.advance_to(0.5)

    # The image of the second capture is not there, so that its track is that of the first.
    assert bench.scene.looks == [0.125]
    assert bench.points.stamp == 0.125
