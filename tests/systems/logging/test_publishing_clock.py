import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, LeafSystem

from poil_drake.runtime import stopwatch as stopwatch_module
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.logging.publishing_clock import PublishingClock


class FakeTime:
    """A clock that goes on only when work is done."""

    now = 0.0

    def perf_counter(self) -> float:
        return self.now


class Worker(LeafSystem):
    """Publishes for 2 s and updates for 5 s, each at every 1/8 s."""

    def __init__(self, time: FakeTime, offset: float = 0.0):
        super().__init__()
        self._time = time
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicPublishEvent(1 / 8, offset, self._publish)
        self.DeclarePeriodicDiscreteUpdateEvent(1 / 8, 0.0, self._update)

    def _publish(self, context: Context) -> None:
        self._time.now += 2.0

    def _update(self, context: Context, state: DiscreteValues) -> None:
        self._time.now += 5.0


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> FakeTime:
    fake = FakeTime()
    monkeypatch.setattr(stopwatch_module, "time", fake)
    return fake


def simulate(*workers: LeafSystem, schedules: list[tuple[float, float]]) -> Stopwatch:
    """Runs workers between the clock's two ends for half a second."""
    stopwatch, builder = Stopwatch(), DiagramBuilder()
    clock = PublishingClock(stopwatch, schedules)
    clock.AddStart(builder)
    for worker in workers:
        builder.AddSystem(worker)
    clock.AddStop(builder)
    Simulator(builder.Build()).AdvanceTo(0.5)
    return stopwatch


def test_publishing_is_measured_and_updates_are_not(time: FakeTime) -> None:
    dut = simulate(Worker(time), Worker(time), schedules=[(1 / 8, 0.0)])

    # At 0, 1/8, ..., 1/2 both publish, one after the other; updates run at the first four.
    assert dut.totals() == {"publishing": 5 * 2 * 2.0}
    assert time.now == 5 * 2 * 2.0 + 4 * 2 * 5.0


def test_schedules_that_meet_count_once(time: FakeTime) -> None:
    dut = simulate(Worker(time), schedules=[(1 / 8, 0.0), (1 / 16, 0.0)])

    assert dut.totals() == {"publishing": 5 * 2.0}


def test_publishing_with_an_offset_has_a_schedule_of_its_own(time: FakeTime) -> None:
    dut = simulate(
        Worker(time), Worker(time, offset=1 / 16), schedules=[(1 / 8, 0.0), (1 / 8, 1 / 16)]
    )

    # The second one publishes at 1/16, 3/16, 5/16 and 7/16.
    assert dut.totals() == {"publishing": (5 + 4) * 2.0}
