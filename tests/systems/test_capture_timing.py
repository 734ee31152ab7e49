from collections.abc import Iterable
from concurrent.futures import Future

import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.errors import InvalidValueError
from poil_drake.systems.capture_timing import (
    Captured,
    Queue,
    RecordedTiming,
    SimulatedDelay,
    Worker,
)


def done(value: object = None) -> Future:
    future: Future = Future()
    future.set_result(value)
    return future


def value(entry: Captured | None) -> object:
    return None if entry is None else entry.result.result()


@given(
    period=st.sampled_from([1 / 8, 0.1, 1 / 30]),
    # Latencies in units of the period, up to several periods.
    latency=st.floats(0.0, 4.0),
    offset=st.floats(0.0, 2.0),
)
def test_a_simulated_result_is_due_exactly_its_latency_after_the_capture(
    period: float, latency: float, offset: float
) -> None:
    dut = SimulatedDelay(period=period, latency=latency * period, offset=offset * period)
    queue: Queue = ()
    # Events in the order of time; at one instant captures are handled before releases.
    events = [(dut.offset + k * period, 0, k) for k in range(20)]
    events += [(dut.offset + k * period + dut.latency, 1, k) for k in range(15)]

    for time, kind, k in sorted(events):
        if kind == 0:
            queue = dut.added(queue, time, done(k))
        else:
            assert value(dut.due(queue, time)) == k


@pytest.mark.parametrize(
    ("latency", "ticks", "kept"),
    [
        (1 / 16, range(10), [8, 9]),
        (0.0, [0, 8], [0, 8]),  # The last capture stays until the next, however long ago it was.
    ],
)
def test_a_simulated_delay_forgets_all_but_the_last_release(
    latency: float, ticks: Iterable[int], kept: list[int]
) -> None:
    dut = SimulatedDelay(period=1 / 8, latency=latency)
    queue: Queue = ()

    for tick in ticks:
        queue = dut.added(queue, tick / 8, done())

    assert [entry.tick for entry in queue] == kept


@pytest.mark.parametrize(
    ("period", "latency", "offset"),
    [(0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.1, -0.1, 0.0), (0.1, 0.0, -0.1)],
)
def test_impossible_times_are_refused(period: float, latency: float, offset: float) -> None:
    with pytest.raises(InvalidValueError, match="latency"):
        SimulatedDelay(period=period, latency=latency, offset=offset)


@pytest.mark.parametrize(
    ("latency", "immediate"), [(0.0, True), (3.5e-18, True), (1e-6, False), (1 / 16, False)]
)
def test_rounding_is_no_latency(latency: float, immediate: bool) -> None:
    dut = SimulatedDelay(period=1 / 8, latency=latency)

    assert (dut.release_event is None) is immediate


def test_a_busy_worker_captures_and_releases_nothing() -> None:
    dut = Worker()
    busy: Future = Future()
    queue = dut.added((), 0.0, busy)

    assert not dut.captures(queue, 0.1, wanted=True)
    assert dut.due(queue, 0.1) is None
    busy.set_result("late")
    assert dut.captures(queue, 0.2, wanted=True)
    assert value(dut.due(queue, 0.2)) == "late"


def test_a_worker_releases_its_result_while_the_next_capture_is_in_work() -> None:
    dut = Worker()

    queue = dut.added(dut.added((), 0.0, done("first")), 0.1, Future())

    assert value(dut.due(queue, 0.1)) == "first"


@pytest.mark.parametrize("timing", [SimulatedDelay(), Worker()])
def test_nothing_is_captured_unless_it_is_wanted(timing: SimulatedDelay | Worker) -> None:
    assert timing.captures((), 0.0, wanted=True)
    assert not timing.captures((), 0.0, wanted=False)


CAPTURED = [0.125, 0.3, 0.55]
RELEASED = [(0.25, 0.125), (0.7, 0.55)]


@pytest.fixture
def replay() -> RecordedTiming:
    return RecordedTiming(captured=CAPTURED, released=RELEASED)


def test_a_replay_captures_each_recorded_frame_once(replay: RecordedTiming) -> None:
    queue, captured = (), []
    for time in (0.0, 0.125, 0.29, 0.3, 0.31, 9.0):
        if replay.captures(queue, time, wanted=False):
            queue = replay.added(queue, time, done())
            captured.append((time, queue[-1].tick))

    assert captured == [(0.125, 0), (0.3, 1), (9.0, 2)]


def test_a_release_of_an_unknown_capture_shows_nothing() -> None:
    # As in a recording that begins after a capture.
    dut = RecordedTiming(captured=CAPTURED, released=[(0.125, 0.05), (0.25, 0.125)])
    queue = dut.added((), 0.125, done(0))

    assert [value(dut.due(queue, time)) for time in (0.125, 0.25)] == [None, 0]


def test_a_release_before_its_capture_is_rejected() -> None:
    with pytest.raises(InvalidValueError, match="precedes its capture"):
        RecordedTiming(captured=[0.1], released=[(0.05, 0.1)])
