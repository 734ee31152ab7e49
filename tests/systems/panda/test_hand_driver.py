import math

import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.systems.panda.hand_driver import HandDriver, step_width


@pytest.mark.parametrize(
    ("width", "wanted", "expected"),
    [
        (0.05, 0.00, 0.049),  # 0.1 m/s for 0.01 s is 1 mm
        (0.05, 0.08, 0.051),
        (0.05, 0.0503, 0.0503),
        (0.0795, 0.2, 0.08),  # no wider than the hand
        (0.0005, -0.1, 0.0),
    ],
)
def test_the_width_follows_at_its_speed(width: float, wanted: float, expected: float) -> None:
    assert step_width(width=width, wanted=wanted, speed=0.1, time_step=0.01) == pytest.approx(
        expected
    )


def test_the_hand_holds_its_opening_until_a_width_is_asked_for() -> None:
    dut = HandDriver(speed=0.1, time_step=1 / 512)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("width_measured").FixValue(context, [0.06])
    position = dut.GetOutputPort("finger_position")
    velocity = dut.GetOutputPort("finger_velocity")
    simulator = Simulator(dut, context)

    assert position.Eval(context)[0] == pytest.approx(0.03)
    simulator.AdvanceTo(0.25)
    assert position.Eval(context)[0] == pytest.approx(0.03)
    dut.GetInputPort("width").FixValue(context, [math.nan])
    simulator.AdvanceTo(0.5)
    assert position.Eval(context)[0] == pytest.approx(0.03)

    dut.GetInputPort("width").FixValue(context, [0.04])
    simulator.AdvanceTo(0.6)
    # Both fingers share 0.1 m/s.
    assert velocity.Eval(context)[0] == pytest.approx(-0.05)
    simulator.AdvanceTo(1.0)
    assert position.Eval(context)[0] == pytest.approx(0.02)
    assert velocity.Eval(context)[0] == 0.0


def test_a_width_acts_only_through_the_state() -> None:
    dut = HandDriver(speed=0.1, time_step=1 / 512)

    pairs = {
        (dut.get_input_port(i).get_name(), dut.get_output_port(o).get_name())
        for i in range(dut.num_input_ports())
        for o in range(dut.num_output_ports())
        if dut.HasDirectFeedthrough(i, o)
    }

    # The measured opening shows before the first step; a wanted one never at once.
    assert pairs == {("width_measured", "finger_position")}


def test_a_width_that_becomes_nan_stops_the_hand_where_it_is() -> None:
    dut = HandDriver(speed=0.1, time_step=1 / 512)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("width_measured").FixValue(context, [0.06])
    dut.GetInputPort("width").FixValue(context, [0.0])
    simulator = Simulator(dut, context)
    simulator.AdvanceTo(0.25)
    position = dut.GetOutputPort("finger_position")
    reached = position.Eval(context)[0]
    assert reached == pytest.approx((0.06 - 0.1 * 0.25) / 2)

    dut.GetInputPort("width").FixValue(context, [math.nan])
    simulator.AdvanceTo(0.5)

    assert position.Eval(context)[0] == pytest.approx(reached)
    assert dut.GetOutputPort("finger_velocity").Eval(context)[0] == 0.0


def test_after_a_reset_the_measured_opening_counts() -> None:
    dut = HandDriver(speed=0.1, time_step=1 / 512)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("width_measured").FixValue(context, [0.06])
    Simulator(dut, context).AdvanceTo(0.1)
    dut.GetInputPort("width_measured").FixValue(context, [0.02])

    dut.Reset(context)

    assert dut.GetOutputPort("finger_position").Eval(context)[0] == pytest.approx(0.01)


def test_an_opening_that_is_no_number_moves_nothing() -> None:
    dut = HandDriver(speed=0.1, time_step=1 / 512)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("width_measured").FixValue(context, [math.nan])
    dut.GetInputPort("width").FixValue(context, [0.04])
    simulator = Simulator(dut, context)

    simulator.AdvanceTo(0.1)
    assert dut.GetOutputPort("finger_velocity").Eval(context)[0] == 0.0
    dut.GetInputPort("width_measured").FixValue(context, [0.06])
    simulator.AdvanceTo(0.2)

    # Once it is known, the fingers go, together at 0.1 m/s.
    assert dut.GetOutputPort("finger_velocity").Eval(context)[0] == pytest.approx(-0.05)


def test_a_step_is_that_of_the_pure_function() -> None:
    dut = HandDriver(speed=0.1, time_step=1 / 512)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("width_measured").FixValue(context, [0.06])
    dut.GetInputPort("width").FixValue(context, [0.04])

    Simulator(dut, context).AdvanceTo(1 / 1024)

    width = step_width(width=0.06, wanted=0.04, speed=0.1, time_step=1 / 512)
    assert dut.GetOutputPort("finger_position").Eval(context)[0] == width / 2
    assert dut.GetOutputPort("finger_velocity").Eval(context)[0] == (width - 0.06) * 512 / 2
