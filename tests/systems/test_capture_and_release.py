"""When a `CaptureAndRelease` captures, works, waits and shows results."""

import threading
from collections.abc import Callable

import numpy as np
import pytest
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, State
from system_bench import SystemBench

from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.capture_and_release import CaptureAndRelease
from poil_drake.systems.capture_timing import (
    Captured,
    CaptureTiming,
    RecordedTiming,
    SimulatedDelay,
    Worker,
)

PERIOD = 1 / 8
AFTER = 1 / 1024  # Long enough after an event to see its effect.


class Chain(LeafSystem):
    """Each result is the list of all capture times so far."""

    def __init__(
        self,
        timing: CaptureTiming,
        *,
        thread: str | None = "test's thread",
        skip: float | None = None,
        go: threading.Event | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        super().__init__()
        self._skip, self._go = skip, go
        self.captured: list[float] = []
        self.dut = CaptureAndRelease(
            system=self,
            timing=timing,
            nothing=(),
            begin=self._begin,
            thread=thread,
            stopwatch=stopwatch,
        )
        self.DeclareAbstractOutputPort("result", lambda: Value(()), self._calc, self.dut.tickets)
        self.dut.DeclareTimesPort()

    def _begin(
        self, context: Context, state: State, previous: Captured | None
    ) -> Callable[[], tuple[float, ...]] | None:
        now = context.get_time()
        if now == self._skip:
            return None
        self.captured.append(now)

        def work() -> tuple[float, ...]:
            if self._go is not None:
                self._go.wait()
            return (*(previous.result.result() if previous else ()), now)

        return work

    def _calc(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.dut.result(context))


@pytest.mark.parametrize("thread", [None, "test's thread"])
@pytest.mark.parametrize("offset", [0.0, 3 / 32])
@pytest.mark.parametrize("latency", [0.0, 3.5e-18, 1 / 64, 1 / 16, 1 / 8, 3 / 16, 1 / 4, 0.3])
def test_a_simulated_result_shows_exactly_its_latency_after_its_capture(
    latency: float, offset: float, thread: str | None
) -> None:
    timing = SimulatedDelay(period=PERIOD, latency=latency, offset=offset)
    bench = SystemBench(Chain(timing, thread=thread))
    captures: tuple[float, ...] = ()

    for tick in range(4):
        capture = offset + tick * PERIOD
        if capture + latency > AFTER:  # Initialization runs the updates of time zero.
            bench.advance_to(capture + latency)
            assert bench.read("result") == captures
        captures = (*captures, capture)
        bench.advance_to(capture + latency + AFTER)
        assert bench.read("result") == captures

    assert bench.dut.captured[:4] == list(captures)


def test_times_are_those_of_the_last_capture_and_release() -> None:
    bench = SystemBench(Chain(SimulatedDelay(period=PERIOD, latency=3 / 16)))
    shown = []

    for time in (0.0, 0.1875, 0.25, 0.3125):
        bench.advance_to(time + AFTER)
        shown.append(bench.read("times").tolist())

    assert shown == [
        [0.0, -np.inf, -np.inf],
        [0.125, 0.1875, 0.0],
        [0.25, 0.1875, 0.0],
        [0.25, 0.3125, 0.125],
    ]


def test_without_a_capture_the_last_result_stays() -> None:
    bench = SystemBench(Chain(SimulatedDelay(period=PERIOD, latency=1 / 16), skip=PERIOD))

    bench.advance_to(PERIOD + 1 / 16 + AFTER)
    assert bench.read("result") == (0.0,)
    bench.advance_to(2 * PERIOD + 1 / 16 + AFTER)
    assert bench.read("result") == (0.0, 2 * PERIOD)


def test_the_simulation_continues_until_a_result_is_due_and_then_waits_for_it() -> None:
    go, stopwatch = threading.Event(), Stopwatch()
    timing = SimulatedDelay(period=PERIOD, latency=1 / 16)
    bench = SystemBench(Chain(timing, go=go, stopwatch=stopwatch))
    bench.advance_to(1 / 16)  # Would never return if it waited at the capture.

    threading.Timer(0.05, go.set).start()
    bench.advance_to(1 / 16 + AFTER)

    assert bench.read("result") == (0.0,)
    assert stopwatch.durations("waiting").max() > 0.0


def test_a_workers_late_result_is_late_and_blocks_nothing() -> None:
    go = threading.Event()
    bench = SystemBench(Chain(Worker(period=PERIOD, poll_period=1 / 256), go=go))
    bench.advance_to(0.5 + AFTER)  # Would never return if it waited for the worker.

    before = bench.read("result")
    go.set()
    bench.dut.dut.close()  # Finishes the work in progress.
    bench.advance_to(0.5 + 1 / 256 + AFTER)

    assert before == ()
    assert bench.dut.captured == [0.0]  # Captures are skipped while it is busy.
    assert bench.read("result") == (0.0,)


def test_a_recording_captures_and_releases_at_its_times() -> None:
    # Captures in unequal steps; the second result was never released.
    timing = RecordedTiming(
        captured=(1 / 64, 10 / 64, 20 / 64),
        released=((9 / 64, 1 / 64), (31 / 64, 20 / 64)),
        period=1 / 64,
    )
    bench = SystemBench(Chain(timing))
    shown = []

    for tick in range(33):
        bench.advance_to(tick / 64 + AFTER)
        shown.append(len(bench.read("result")))

    assert bench.dut.captured == [1 / 64, 10 / 64, 20 / 64]
    assert shown == [0] * 9 + [1] * 22 + [3] * 2


def test_an_error_shows_when_the_result_is_due() -> None:
    chain = Chain(SimulatedDelay(period=PERIOD, latency=1 / 16))
    bench = SystemBench(chain)
    chain.dut._begin = lambda context, state, previous: lambda: 1 / 0

    bench.advance_to(1 / 16)
    with pytest.raises(ZeroDivisionError):
        bench.advance_to(1 / 16 + AFTER)


def test_nothing_feeds_through() -> None:
    assert not Chain(SimulatedDelay()).HasAnyDirectFeedthrough()
