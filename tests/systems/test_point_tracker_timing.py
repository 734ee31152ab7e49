"""When the point tracker looks, works and reports."""

import threading

import numpy as np
import pytest
from point_tracker_bench import AFTER, MASKS, PERIOD, QUERY, MakeBench, N, Scene, SummingTracker

from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.capture_timing import RecordedTiming, SimulatedDelay, Worker
from poil_drake.systems.statuses import TrackerStatus


def test_before_the_first_event_nothing_is_tracked(make_bench: MakeBench) -> None:
    bench = make_bench()

    assert bench.read("status") == TrackerStatus.WAITING
    assert bench.points.stamp == -np.inf
    np.testing.assert_array_equal(bench.points.confidence, np.zeros(N))
    assert bench.read("frame") is ABSENT


@pytest.mark.parametrize("latency", [1 / 64, 1 / 16, 1 / 8, 3 / 16, 1 / 4, 0.3])
def test_each_capture_is_released_exactly_its_latency_later(
    make_bench: MakeBench, latency: float
) -> None:
    bench = make_bench(timing=SimulatedDelay(period=PERIOD, latency=latency))
    previous = -np.inf

    for tick in range(4):
        stamp = tick * PERIOD
        # Time's end is before the updates of that instant.
        bench.advance_to(stamp + latency)
        assert bench.points.stamp == previous
        bench.advance_to(stamp + latency + AFTER)
        assert bench.points.stamp == stamp
        assert bench.read("status") == TrackerStatus.TRACKING
        previous = stamp


def test_with_an_offset_everything_comes_that_much_later(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(period=PERIOD, offset=3 / 32, latency=3 / 16)
    bench = make_bench(timing=timing)

    bench.advance_to(3 / 32 + 3 / 16)
    assert bench.points.stamp == -np.inf
    bench.advance_to(3 / 32 + 3 / 16 + AFTER)
    assert bench.points.stamp == 3 / 32
    bench.advance_to(0.5)

    assert bench.scene.looks == [3 / 32, 7 / 32, 11 / 32, 15 / 32]


@pytest.mark.parametrize("latency", [0.0, 3.5e-18])
def test_without_latency_a_capture_is_released_at_once(
    make_bench: MakeBench, latency: float
) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=latency))

    bench.advance_to(AFTER)

    assert bench.points.stamp == 0.0
    np.testing.assert_array_equal(bench.points.positions, QUERY)


def test_images_are_looked_at_once_per_capture(make_bench: MakeBench) -> None:
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


def test_nothing_feeds_through(make_bench: MakeBench) -> None:
    assert not make_bench().dut.HasAnyDirectFeedthrough()


def test_a_stopwatch_counts_the_work(make_bench: MakeBench) -> None:
    stopwatch = Stopwatch()
    bench = make_bench(timing=SimulatedDelay(latency=0.0), stopwatch=stopwatch)

    bench.advance_to(0.3)

    assert stopwatch.durations("tracking").shape == (3,)


class PausedTracker(SummingTracker):
    """Goes on only when told."""

    def __init__(self) -> None:
        self.go = threading.Event()

    def start(self, *arguments) -> TrackerOutput:
        self.go.wait()
        return super().start(*arguments)


def test_on_hardware_a_late_result_is_late_and_blocks_nothing(make_bench: MakeBench) -> None:
    tracker = PausedTracker()
    timing = Worker(period=1 / 8, poll_period=1 / 256)
    bench = make_bench(timing=timing, tracker=tracker)

    bench.advance_to(0.5 + AFTER)  # would never come back if it waited for the tracker
    status = bench.read("status")
    tracker.go.set()
    bench.dut.close()  # the work in hand is finished first
    bench.advance_to(0.5 + 1 / 256 + AFTER)

    assert status == TrackerStatus.WAITING
    assert bench.scene.looks == [0.0]  # frames that come while it is busy are skipped
    assert bench.read("status") == TrackerStatus.TRACKING
    assert bench.points.stamp == 0.0


def test_images_may_be_looked_for_more_often_than_they_are_tracked(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(period=1 / 64, latency=0.0)
    bench = make_bench(timing=timing, min_interval=0.1, with_stamps=True)

    bench.advance_to(0.5)

    # The first look at which the image is 0.1 s newer than the one before, each time.
    assert bench.scene.looks == [0.0, 7 / 64, 14 / 64, 21 / 64, 28 / 64]


def test_points_may_be_looked_for_only_until_they_are_found(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(latency=0.0)
    bench = make_bench(timing=timing, once=True, masks=ABSENT, with_stamps=True)
    bench.advance_to(2 * PERIOD + AFTER)
    assert bench.read("status") == TrackerStatus.WAITING
    bench.fix(masks=MASKS)

    bench.advance_to(8 * PERIOD)

    assert bench.read("status") == TrackerStatus.TRACKING
    assert bench.points.stamp == 3 * PERIOD
    assert bench.scene.looks == [0.0, PERIOD, 2 * PERIOD, 3 * PERIOD]


def test_the_times_of_captures_and_releases_are_told(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=0.1875))
    told = []
    for time in (0.0, 0.1875, 0.25, 0.3125):
        bench.advance_to(time + AFTER)
        told.append(bench.read("times").tolist())

    assert told == [
        [0.0, -np.inf, -np.inf],
        [0.125, 0.1875, 0.0],
        [0.25, 0.1875, 0.0],
        [0.25, 0.3125, 0.125],
    ]


class SlowTracker(SummingTracker):
    """Takes its time, so that a replay which does not await it is caught."""

    def start(self, *arguments) -> TrackerOutput:
        threading.Event().wait(0.05)
        return super().start(*arguments)


def test_a_replay_captures_and_releases_when_the_run_did(make_bench: MakeBench) -> None:
    # Captures in unequal steps, and the second one was never released.
    timing = RecordedTiming(
        captured=(1 / 64, 10 / 64, 20 / 64), released=((9 / 64, 0), (31 / 64, 2)), period=1 / 64
    )
    bench = make_bench(timing=timing, tracker=SlowTracker(), with_stamps=True)
    stamps = []
    for tick in range(33):
        bench.advance_to(tick / 64 + AFTER)
        stamps.append(bench.points.stamp)

    assert bench.scene.looks == [1 / 64, 10 / 64, 20 / 64]
    assert stamps == [-np.inf] * 9 + [1 / 64] * 22 + [20 / 64] * 2


def test_a_replay_skips_what_its_log_lacks(make_bench: MakeBench) -> None:
    timing = RecordedTiming(
        captured=(0.125, 0.25), released=((0.1875, 0), (0.3125, 1)), period=1 / 64
    )
    bench = make_bench(timing=timing, scene=Scene(frozen_from=0.125), with_stamps=True)

    bench.advance_to(0.5)

    # The image of the second capture is not there, so that its track is that of the first.
    assert bench.scene.looks == [0.125]
    assert bench.points.stamp == 0.125
