import math

import pytest
from system_bench import SystemBench

from poil_drake.systems.panda.hand_driver import HandDriver


@pytest.fixture
def bench() -> SystemBench:
    """The hand is 0.06 m open, and moves at 0.1 m/s."""
    return SystemBench(HandDriver(speed=0.1, time_step=1 / 512), width_measured=0.06)


@pytest.mark.parametrize(
    ("width", "wanted", "expected"),
    [
        (0.05, 0.00, 0.049),  # 0.1 m/s for 0.01 s is 1 mm.
        (0.05, 0.08, 0.051),
        (0.05, 0.0503, 0.0503),
        (0.0795, 0.2, 0.08),  # No wider than the hand.
        (0.0005, -0.1, 0.0),
    ],
)
def test_the_width_follows_at_its_speed(width: float, wanted: float, expected: float) -> None:
    bench = SystemBench(HandDriver(speed=0.1, time_step=0.01), width_measured=width, width=wanted)

    bench.advance_to(0.005)

    assert bench.read("finger_position")[0] == pytest.approx(expected / 2)


def test_the_hand_holds_its_opening_until_a_width_is_commanded(bench: SystemBench) -> None:
    assert bench.read("finger_position")[0] == pytest.approx(0.03)
    bench.advance_to(0.25)
    assert bench.read("finger_position")[0] == pytest.approx(0.03)
    bench.fix(width=math.nan)
    bench.advance_to(0.5)
    assert bench.read("finger_position")[0] == pytest.approx(0.03)

    bench.fix(width=0.04)
    bench.advance_to(0.6)
    # Both fingers share 0.1 m/s.
    assert bench.read("finger_velocity")[0] == pytest.approx(-0.05)
    bench.advance_to(1.0)
    assert bench.read("finger_position")[0] == pytest.approx(0.02)
    assert bench.read("finger_velocity")[0] == 0.0


def test_a_width_acts_only_through_the_state(bench: SystemBench) -> None:
    dut = bench.dut
    width, measured = (dut.GetInputPort(name).get_index() for name in ("width", "width_measured"))
    position = dut.GetOutputPort("finger_position").get_index()

    # Before the first step the measured opening passes through.
    assert dut.HasDirectFeedthrough(measured, position)
    assert not dut.HasDirectFeedthrough(width, position)
    assert not dut.HasDirectFeedthrough(dut.GetOutputPort("finger_velocity").get_index())


def test_a_nan_width_stops_the_hand(bench: SystemBench) -> None:
    bench.fix(width=0.0)
    bench.advance_to(0.25)
    reached = bench.read("finger_position")[0]
    assert reached == pytest.approx((0.06 - 0.1 * 0.25) / 2)

    bench.fix(width=math.nan)
    bench.advance_to(0.5)

    assert bench.read("finger_position")[0] == pytest.approx(reached)
    assert bench.read("finger_velocity")[0] == 0.0


def test_after_a_reset_the_measured_opening_counts(bench: SystemBench) -> None:
    bench.advance_to(0.1)
    bench.fix(width_measured=0.02)

    bench.dut.Reset(bench.context)

    assert bench.read("finger_position")[0] == pytest.approx(0.01)


def test_with_a_nan_opening_the_fingers_rest(bench: SystemBench) -> None:
    bench.fix(width_measured=math.nan, width=0.04)
    bench.advance_to(0.1)
    assert bench.read("finger_velocity")[0] == 0.0

    bench.fix(width_measured=0.06)
    bench.advance_to(0.2)

    assert bench.read("finger_velocity")[0] == pytest.approx(-0.05)
