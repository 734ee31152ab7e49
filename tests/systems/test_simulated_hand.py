import numpy as np
import pytest
from drake import lcmt_schunk_wsg_status
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator

from poil_drake.systems.panda_lcm_messages import HAND_PERIOD, encode_hand_command
from poil_drake.systems.simulated_hand import SimulatedHand

START = 1_790_000_000.0


class Bench:
    """The dut with a hand that is moved by hand, and a client on a network in memory."""

    def __init__(self, width: float = 0.08):
        self.lcm = DrakeLcm("memq://hand_driver")
        self.dut = SimulatedHand(
            lcm=self.lcm, command_channel="COMMAND", status_channel="STATUS", clock=self.now
        )
        self.simulator = Simulator(self.dut)
        self.context = self.simulator.get_mutable_context()
        self.move(width)
        self.said: list[lcmt_schunk_wsg_status] = []
        self.lcm.Subscribe(
            "STATUS", lambda raw: self.said.append(lcmt_schunk_wsg_status.decode(raw))
        )

    def now(self) -> float:
        return START + self.context.get_time()

    def move(self, width: float) -> None:
        self.dut.GetInputPort("width_measured").FixValue(self.context, [width])

    def tell(self, width: float) -> None:
        self.lcm.Publish("COMMAND", encode_hand_command(width, 40.0, self.now()))
        self.lcm.HandleSubscriptions(0)

    def advance(self, periods: int = 1) -> float:
        """Returns the width that is commanded after some periods."""
        for _ in range(periods):
            self.simulator.AdvanceTo(self.context.get_time() + HAND_PERIOD)
        self.lcm.HandleSubscriptions(0)
        return float(self.dut.GetOutputPort("width").Eval(self.context)[0])


def test_before_the_first_command_the_hand_holds_what_it_has() -> None:
    assert np.isnan(Bench().advance(3))


def test_width_is_taken_at_the_next_look() -> None:
    bench = Bench()
    bench.advance()

    bench.tell(0.03)

    assert bench.advance(2) == pytest.approx(0.03)


def test_nothing_else_is_done_before_the_motion_has_ended() -> None:
    bench = Bench()
    bench.tell(0.03)
    bench.advance()
    bench.tell(0.05)

    for width in (0.07, 0.06, 0.05, 0.04):
        bench.move(width)
        assert bench.advance() == pytest.approx(0.03)

    # Something is in the way: the fingers stand still.
    assert bench.advance(2) == pytest.approx(0.05)


def test_status_has_the_width_and_no_force() -> None:
    bench = Bench(width=0.042)

    bench.advance(5)

    assert len(bench.said) in (5, 6)
    assert bench.said[-1].actual_position_mm == pytest.approx(42.0)
    assert {status.actual_force for status in bench.said} == {0.0}
    assert bench.said[-1].actual_speed_mm_per_s == 0.0
    assert bench.said[-1].utime == pytest.approx(1e6 * bench.now(), abs=1.1e5)


def test_hand_on_its_way_claims_the_drivers_speed() -> None:
    bench = Bench()

    bench.tell(0.03)
    bench.advance()

    assert bench.said[-1].actual_speed_mm_per_s == 5.0
