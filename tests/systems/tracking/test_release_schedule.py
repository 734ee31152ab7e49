import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.errors import InvalidValueError
from poil_drake.systems.tracking.release_schedule import Captured, ReleaseSchedule


@given(
    period=st.sampled_from([1 / 8, 0.1, 1 / 30]),
    # Latencies in units of the period, up to several periods.
    latency=st.floats(0.0, 4.0),
    offset=st.floats(0.0, 2.0),
)
def test_every_capture_is_there_when_it_is_due(
    period: float, latency: float, offset: float
) -> None:
    dut = ReleaseSchedule(period=period, latency=latency * period, offset=offset * period)
    queue: tuple[Captured, ...] = ()
    # Events in the order of time; at one instant captures are handled before releases.
    events = [(dut.offset + k * period, 0, k) for k in range(20)]
    events += [(dut.release_time(k), 1, k) for k in range(15)]

    for time, kind, k in sorted(events):
        if kind == 0:
            queue = dut.added(queue, time, f"item {k}")
        else:
            assert dut.due(queue, time) == Captured(k, f"item {k}")


def test_what_was_released_is_forgotten() -> None:
    dut = ReleaseSchedule(period=1 / 8, latency=1 / 16)
    queue: tuple[Captured, ...] = ()

    for k in range(10):
        queue = dut.added(queue, k / 8, k)

    assert [entry.tick for entry in queue] == [8, 9]


def test_nothing_is_due_for_a_capture_that_was_left_out() -> None:
    dut = ReleaseSchedule(period=1 / 8, latency=1 / 16)
    queue = dut.added((), 0.0, "first")

    assert dut.due(queue, 1 / 8 + 1 / 16) is None


def test_the_last_capture_stays_however_long_ago() -> None:
    dut = ReleaseSchedule(period=1 / 8, latency=0.0)
    queue = dut.added((), 0.0, "first")

    queue = dut.added(queue, 1.0, "second")

    assert queue == (Captured(0, "first"), Captured(8, "second"))


def test_a_release_comes_a_latency_after_its_capture() -> None:
    dut = ReleaseSchedule(period=1 / 8, latency=3 / 16, offset=1 / 32)

    # Captures at 1/32, 5/32, 9/32.
    assert [dut.release_time(k) for k in range(3)] == [7 / 32, 11 / 32, 15 / 32]
    assert dut.capture_tick(9 / 32) == 2


@pytest.mark.parametrize(
    ("period", "latency", "offset"),
    [(0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.1, -0.1, 0.0), (0.1, 0.0, -0.1)],
)
def test_impossible_times_are_refused(period: float, latency: float, offset: float) -> None:
    with pytest.raises(InvalidValueError, match="latency"):
        ReleaseSchedule(period=period, latency=latency, offset=offset)


@pytest.mark.parametrize(
    ("latency", "immediate"), [(0.0, True), (3.5e-18, True), (1e-6, False), (1 / 16, False)]
)
def test_rounding_is_no_latency(latency: float, immediate: bool) -> None:
    assert ReleaseSchedule(period=1 / 8, latency=latency).immediate is immediate
