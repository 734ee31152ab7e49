from functools import partial

import numpy as np
import pytest
from drake import lcmt_schunk_wsg_status
from network_bench import NetworkBench

from poil_drake.systems.lcm.panda_messages import HAND_PERIOD, HandOpening, encode_hand_command
from poil_drake.systems.lcm.simulated_hand import SimulatedHand


@pytest.fixture
def bench() -> NetworkBench:
    make = partial(SimulatedHand, command_channel="COMMAND", status_channel="STATUS")
    return NetworkBench(make, width_measured=0.08)


def command(bench: NetworkBench, width: float) -> None:
    bench.publish("COMMAND", encode_hand_command(HandOpening(bench.now(), width), 40.0))


def test_before_the_first_command_the_hand_has_no_target(bench: NetworkBench) -> None:
    bench.advance(3 * HAND_PERIOD)

    assert np.isnan(bench.read("width"))


def test_width_is_taken_at_the_next_update(bench: NetworkBench) -> None:
    bench.advance(HAND_PERIOD)

    command(bench, 0.03)
    bench.advance(2 * HAND_PERIOD)

    assert bench.read("width") == pytest.approx(0.03)


def test_the_next_command_is_executed_after_the_motion(bench: NetworkBench) -> None:
    command(bench, 0.03)
    bench.advance(HAND_PERIOD)
    command(bench, 0.05)

    for width in (0.07, 0.06, 0.05, 0.04):
        bench.fix(width_measured=width)
        bench.advance(HAND_PERIOD)
        assert bench.read("width") == pytest.approx(0.03)

    # The fingers are blocked and at rest.
    bench.advance(2 * HAND_PERIOD)
    assert bench.read("width") == pytest.approx(0.05)


def test_status_has_the_width_and_no_force(bench: NetworkBench) -> None:
    statuses = bench.hear("STATUS", lcmt_schunk_wsg_status.decode)
    bench.fix(width_measured=0.042)

    bench.advance(5 * HAND_PERIOD)

    assert len(statuses) in (5, 6)
    assert statuses[-1].actual_position_mm == pytest.approx(42.0)
    assert {status.actual_force for status in statuses} == {0.0}
    assert statuses[-1].actual_speed_mm_per_s == 0.0
    assert statuses[-1].utime == pytest.approx(1e6 * bench.now(), abs=1.1e5)


def test_a_moving_hand_reports_the_drivers_speed(bench: NetworkBench) -> None:
    statuses = bench.hear("STATUS", lcmt_schunk_wsg_status.decode)

    command(bench, 0.03)
    bench.advance(HAND_PERIOD)

    assert statuses[-1].actual_speed_mm_per_s == 5.0
