import time

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.diagrams.run import real_time_loop
from poil_drake.diagrams.run.real_time_loop import LoopTiming, RealTimeLoop
from poil_drake.runtime.interpreter_turns import TURNS

PERIOD = 1 / 256


class FakeTime:
    """A fake module `time`: time passes only in `sleep`."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now

    def sleep(self, duration: float) -> None:
        self.now += duration


class Worker(LeafSystem):
    """Works for 1 ms in each period, and in one of them for `pause` [s]."""

    def __init__(self, time: FakeTime, *, slow_tick: int | None = None, pause: float = 0.0):
        super().__init__()
        self._time, self._slow_tick, self._pause = time, slow_tick, pause
        self.ticks = 0
        self.DeclarePeriodicPublishEvent(PERIOD, PERIOD, self._work)

    def _work(self, context: Context) -> None:
        self.ticks += 1
        self._time.sleep(self._pause if self.ticks == self._slow_tick else 0.001)


class TwoPhases(LeafSystem):
    """Computes at the start of each period, and sends after three quarters of it."""

    def __init__(self, time: FakeTime, *, computing: float):
        super().__init__()
        self._time, self._computing = time, computing
        self.began: list[float] = []
        self.sent: list[float] = []
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self._compute)
        self.DeclarePeriodicPublishEvent(PERIOD, 0.75 * PERIOD, self._send)

    def _compute(self, context: Context, state: State) -> None:
        self.began.append(self._time.now)
        self._time.sleep(self._computing)

    def _send(self, context: Context) -> None:
        self.sent.append(self._time.now)


@pytest.fixture
def fake_time(monkeypatch: pytest.MonkeyPatch) -> FakeTime:
    time = FakeTime()
    monkeypatch.setattr(real_time_loop, "time", time)
    return time


def loop_of(system: LeafSystem, **config: float) -> RealTimeLoop:
    return RealTimeLoop(Simulator(system), period=PERIOD, **config)


def test_each_tick_begins_when_it_is_due(fake_time: FakeTime) -> None:
    dut = loop_of(Worker(fake_time))

    dut.AdvanceTo(0.25)
    dut.AdvanceTo(0.5)

    starts = 100.0 + PERIOD * np.arange(128)
    np.testing.assert_allclose(dut.timing.starts, starts, atol=1e-9)
    np.testing.assert_allclose(dut.timing.durations, 0.001, atol=1e-9)
    assert dut.timing.missed == 0


def test_the_loop_catches_up_after_a_short_delay(fake_time: FakeTime) -> None:
    # The tenth tick takes 10 ms, two and a half periods.
    dut = loop_of(Worker(fake_time, slow_tick=10, pause=0.010))

    dut.AdvanceTo(0.25)

    starts = 100.0 + PERIOD * np.arange(64)
    np.testing.assert_allclose(dut.timing.starts[:10], starts[:10], atol=1e-9)
    # The next two are late, and each takes 1 ms.
    np.testing.assert_allclose(
        dut.timing.starts[10:12], starts[9] + np.array([0.010, 0.011]), atol=1e-9
    )
    np.testing.assert_allclose(dut.timing.starts[13:], starts[13:], atol=1e-9)
    # Only the first of them began more than a period late.
    assert dut.timing.missed == 1


def test_the_loop_does_not_catch_up_after_a_long_delay(fake_time: FakeTime) -> None:
    dut = loop_of(Worker(fake_time, slow_tick=10, pause=0.030))

    dut.AdvanceTo(0.25)

    resumed = 100.0 + 9 * PERIOD + 0.030
    np.testing.assert_allclose(dut.timing.starts[10:], resumed + PERIOD * np.arange(54), atol=1e-9)
    # 30 ms less one period are more than six periods.
    assert dut.timing.missed == 6


@pytest.mark.parametrize("computing", [0.0005, 0.002])
def test_events_after_the_pause_are_evenly_spaced(fake_time: FakeTime, computing: float) -> None:
    system = TwoPhases(fake_time, computing=computing)
    dut = loop_of(system, pause=0.75, time_scale=0.5)

    dut.AdvanceTo(0.125)

    # The time scale makes the loop half as fast.
    due = 100.0 + 2.0 * PERIOD * np.arange(32)
    np.testing.assert_allclose(system.began, due, atol=1e-9)
    np.testing.assert_allclose(system.sent, due + 2.0 * 0.75 * PERIOD, atol=1e-9)
    np.testing.assert_allclose(dut.timing.durations, computing, atol=1e-9)


def test_late_events_after_the_pause_do_not_wait(fake_time: FakeTime) -> None:
    system = TwoPhases(fake_time, computing=0.9 * PERIOD)
    dut = loop_of(system, pause=0.75)

    dut.AdvanceTo(0.125)

    due = 100.0 + PERIOD * np.arange(32)
    np.testing.assert_allclose(system.sent, due + 0.9 * PERIOD, atol=1e-9)
    assert dut.timing.missed == 0


def test_other_threads_have_their_turn_while_the_loop_waits(fake_time: FakeTime) -> None:
    turns: list[bool] = []

    class Asks(TwoPhases):
        def _compute(self, context: Context, state: State) -> None:
            turns.append(TURNS._free.is_set())

    sleep, waits = fake_time.sleep, []

    def observed(duration: float) -> None:
        waits.append(TURNS._free.is_set())
        sleep(duration)

    fake_time.sleep = observed  # type: ignore[method-assign]
    dut = loop_of(Asks(fake_time, computing=0.0))

    dut.AdvanceTo(0.125)

    # The first tick is due at once, so the loop does not wait before it.
    assert turns[1:] == [False] * 31
    assert waits == [True] * 31
    assert TURNS._free.is_set()


def test_the_loop_takes_real_time() -> None:
    dut = loop_of(Worker(FakeTime()))

    start = time.perf_counter()
    dut.AdvanceTo(0.125)

    # The last of 32 ticks begins 31 periods after the first.
    assert time.perf_counter() - start >= 31 * PERIOD


def test_figures_are_percentiles() -> None:
    timing = LoopTiming(
        starts=[0.0, 0.004, 0.008, 0.016], lateness=[0.0, 0.0, 0.0, 0.004], durations=[0.001] * 4
    )

    figures = timing.figures()

    assert figures["ticks"] == 4.0
    assert figures["tick_period_p50_ms"] == pytest.approx(4.0)
    assert figures["tick_period_max_ms"] == pytest.approx(8.0)
    assert figures["tick_duration_p999_ms"] == pytest.approx(1.0)


def test_the_log_gets_the_worst_of_the_last_ticks() -> None:
    timing = LoopTiming(
        starts=[0.0] * 3, lateness=[9.0, 0.2, 0.1], durations=[9.0, 0.1, 0.3], missed=4
    )

    assert timing.latest(ticks=2) == {"lateness": 0.2, "duration": 0.3, "missed": 4.0}


def test_a_loop_without_ticks_has_no_percentiles() -> None:
    assert LoopTiming().figures() == {"ticks": 0.0, "missed_ticks": 0.0}
