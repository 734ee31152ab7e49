import pytest
from pydrake.systems.primitives import ConstantVectorSource, ZeroOrderHold

from poil_drake.diagrams.run.simulator import MakeSimulator
from poil_drake.diagrams.scenario.load import LoadScenario

TEXT = (
    "{simulator_config: {target_realtime_rate: 0.5, max_step_size: 0.004, accuracy: 0.02,"
    " integration_scheme: runge_kutta3, use_error_control: true}}"
)


@pytest.mark.parametrize(("given", "rate"), [(None, 0.5), (2.0, 2.0), (0.0, 0.0)])
def test_the_callers_realtime_rate_wins(given: float | None, rate: float) -> None:
    dut = MakeSimulator(ConstantVectorSource([1.0]), LoadScenario(data=TEXT), realtime_rate=given)

    assert dut.get_target_realtime_rate() == rate


def test_the_scenarios_settings_are_applied() -> None:
    dut = MakeSimulator(ConstantVectorSource([1.0]), LoadScenario(data=TEXT))

    assert dut.get_integrator().get_maximum_step_size() == 0.004
    assert dut.get_integrator().get_target_accuracy() == 0.02


def test_steps_of_a_discrete_system_are_its_events_whatever_the_largest_step() -> None:
    hold = ZeroOrderHold(0.01, 1)
    dut = MakeSimulator(hold, LoadScenario(data=TEXT))
    hold.get_input_port().FixValue(dut.get_mutable_context(), [1.0])
    dut.Initialize()
    dut.ResetStatistics()

    dut.AdvanceTo(0.04)

    assert dut.get_num_steps_taken() == 4
