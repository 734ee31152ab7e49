"""When the point tracker captures, and what it reports."""

import numpy as np
import pytest
from point_tracker_bench import AFTER, MASKS, PERIOD, QUERY, MakeBench, Scene, SummingTracker

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


def test_a_nan_motion_is_no_prior(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=0.0), moving=np.nan)

    bench.advance_to(PERIOD + AFTER)

    expected = np.sin(QUERY) + np.float32(1 + PERIOD)
    np.testing.assert_allclose(bench.points.positions, expected, atol=1e-12)


def test_it_waits_for_masks_and_query_points(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=0.0), query_points=None)
    inputs = [(ABSENT, QUERY), (MASKS, np.full(QUERY.shape, np.nan)), (MASKS, QUERY)]
    statuses = []

    for tick, (masks, query_points) in enumerate(inputs):
        bench.fix(masks=masks, query_points=query_points)
        bench.advance_to(tick * PERIOD + AFTER)
        statuses.append(bench.read("status")[0])

    waiting, tracking = TrackerStatus.WAITING, TrackerStatus.TRACKING
    assert statuses == [waiting, waiting, tracking]
    np.testing.assert_array_equal(bench.points.positions, QUERY)


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
    np.testing.assert_array_equal(bench.points.confidence, 0.0)
    assert bench.read("frame") is ABSENT


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


def test_a_least_interval_between_tracked_images_is_kept(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(period=1 / 64, latency=0.0)
    bench = make_bench(timing=timing, min_interval=0.1, with_stamps=True)

    bench.advance_to(0.5)

    # Each time the first image that is at least 0.1 s newer than the last tracked one.
    assert bench.scene.captures == [0.0, 7 / 64, 14 / 64, 21 / 64, 28 / 64]


def test_tracking_once_stops_when_the_points_are_found(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(latency=0.0)
    bench = make_bench(timing=timing, once=True, masks=ABSENT, with_stamps=True)
    bench.advance_to(2 * PERIOD + AFTER)
    assert bench.read("status") == TrackerStatus.WAITING
    bench.fix(masks=MASKS)

    bench.advance_to(8 * PERIOD)

    assert bench.read("status") == TrackerStatus.TRACKING
    assert bench.points.stamp == 3 * PERIOD
    assert bench.scene.captures == [0.0, PERIOD, 2 * PERIOD, 3 * PERIOD]


def test_a_replay_skips_what_its_log_lacks(make_bench: MakeBench) -> None:
    timing = RecordedTiming(
        captured=(0.125, 0.25), released=((0.1875, 0.125), (0.3125, 0.25)), period=1 / 64
    )
    bench = make_bench(timing=timing, scene=Scene(frozen_from=0.125), with_stamps=True)

    bench.advance_to(0.5)

    # The image of the second capture is missing, so that its track is that of the first.
    assert bench.scene.captures == [0.125]
    assert bench.points.stamp == 0.125
