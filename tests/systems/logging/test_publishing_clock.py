import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, LeafSystem

from poil_drake.runtime import stopwatch as stopwatch_module
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.logging.publishing_clock import PublishingClock, Schedule


class FakeTime:
    """A clock that advances only with work."""

    now = 0.0

    def perf_counter(self) -> float:
        return self.now


class Worker(LeafSystem):
    """Publishes for 2 s and updates for 5 s, each at every 1/8 s."""

    def __init__(self, time: FakeTime, offset: float):
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


@pytest.mark.parametrize(
    ("offsets", "schedules", "publications"),
    [
        # At 0, 1/8, ..., 1/2 both workers publish, one after the other.
        ([0.0, 0.0], [(1 / 8, 0.0)], 5 * 2),
        # Schedules that meet count once.
        ([0.0], [(1 / 8, 0.0), (1 / 16, 0.0)], 5),
        # The second one publishes at 1/16, 3/16, 5/16 and 7/16.
        ([0.0, 1 / 16], [(1 / 8, 0.0), (1 / 8, 1 / 16)], 5 + 4),
    ],
    ids=["two workers", "schedules that meet", "offset"],
)
def test_publishing_is_measured_and_updates_are_not(
    time: FakeTime, offsets: list[float], schedules: list[Schedule], publications: int
) -> None:
    stopwatch, builder = Stopwatch(), DiagramBuilder()
    dut = PublishingClock(stopwatch, schedules)
    dut.AddStart(builder)
    for offset in offsets:
        builder.AddSystem(Worker(time, offset))
    dut.AddStop(builder)

    Simulator(builder.Build()).AdvanceTo(0.5)

    assert stopwatch.totals() == {"publishing": publications * 2.0}
    # Updates run at 0, 1/8, 2/8 and 3/8.
    assert time.now == publications * 2.0 + 4 * len(offsets) * 5.0
