import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from system_bench import SystemBench

from poil_drake.recording.run_log.recorded_run import Series
from poil_drake.systems.panda.recorded_robot import (
    HAND,
    JOINTS,
    STATUS,
    RecordedClock,
    RecordedRobot,
)

PERIOD = 1 / 4
TIMES = [0.0, 0.25, 0.5, 0.75]


def make(**options):
    def series(size, offset):
        return Series.of([(t, offset + t + np.zeros(size)) for t in TIMES], size)

    return RecordedRobot(
        joints=series(21, 0.0),
        hand=series(1, 10.0),
        status=series(4, 20.0),
        postures=series(7, 30.0),
        period=PERIOD,
        **options,
    )


class Controller(LeafSystem):
    """Records the time and the input at its updates."""

    def __init__(self):
        super().__init__()
        self.seen = []
        self.DeclareVectorInputPort("input", 1)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._update)

    def _update(self, context, state):
        self.seen.append((context.get_time(), self.GetInputPort("input").Eval(context)[0]))


def seen_by_updates(dut, port):
    """Returns the times of discrete updates and their values of a port of one number."""
    builder = DiagramBuilder()
    builder.AddSystem(dut)
    controller = builder.AddSystem(Controller())
    builder.Connect(dut.GetOutputPort(port), controller.GetInputPort("input"))
    Simulator(builder.Build()).AdvanceTo(1.0)
    return controller.seen


@pytest.mark.parametrize(
    ("leading", "widths"),
    [
        # The sample of 0.25 s was taken before the updates of that time, and after those of 0 s.
        ((JOINTS, HAND, STATUS), [10.25, 10.5, 10.75, 10.75]),
        ((STATUS,), [10.0, 10.25, 10.5, 10.75]),
    ],
)
def test_updates_see_leading_signals_a_sample_early(leading, widths):
    seen = seen_by_updates(make(leading=leading), "width_measured")

    assert seen == list(zip(TIMES, widths, strict=True))


def test_a_sample_is_shown_when_it_was_taken():
    bench = SystemBench(make())
    bench.simulator.Initialize()

    for time in TIMES:
        if time > 0.0:
            bench.advance_to(time)
        np.testing.assert_array_equal(bench.read("position_measured"), np.full(7, time))


@pytest.mark.parametrize(
    ("port", "size", "value"),
    [
        ("position_measured", 7, 0.0),
        ("velocity_measured", 7, 0.0),
        ("torque_external", 7, 0.0),
        ("width_measured", 1, 10.0),
        ("status", 3, 20.0),
        ("position_commanded", 7, 30.0),
    ],
)
def test_every_signal_has_its_port(port, size, value):
    # The inputs are ignored.
    bench = SystemBench(make(), velocity=np.full(7, 9.0), velocity_time=9.0, width=9.0)

    np.testing.assert_array_equal(bench.read(port), np.full(size, value))


def test_before_the_first_sample_nothing_is_known():
    empty = Series.of([], 21)
    dut = RecordedRobot(
        joints=empty, hand=Series.of([], 1), status=Series.of([], 4), postures=Series.of([], 7)
    )
    bench = SystemBench(dut)

    for port in ("position_measured", "status", "width_measured", "position_commanded"):
        assert np.isnan(bench.read(port)).all()


def test_the_clock_shows_the_recorded_time_of_each_period():
    clock = RecordedClock()
    simulator = Simulator(make(clock=clock))
    times = []
    for time in (0.125, 0.375, 0.625):
        simulator.AdvanceTo(time)
        times.append(clock())

    assert times == [20.25, 20.5, 20.75]
