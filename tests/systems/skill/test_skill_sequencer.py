import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import Fault, Phase
from poil_drake.systems.skill.sequencer import SkillSequencer
from poil_drake.systems.skill.state_machine import Observation, SkillConfig, next_state
from poil_drake.systems.statuses import ControllerStatus, IkStatus, TrackerStatus

PERIOD = 1 / 256
GOOD = {
    "tracker_status": [TrackerStatus.TRACKING],
    "controller_status": [ControllerStatus.OK],
    "tau": [0.5],
    "mean_error": [0.02],
    "goal_error": [0.2],
    "motion_done": [0.0],
    "ik_status": [IkStatus.OK],
    "width_measured": [0.08],
    "safety_fault": [SafetyFault.NONE],
}


@pytest.fixture
def dut() -> SkillSequencer:
    return SkillSequencer(config=SkillConfig(), period=PERIOD)


def context_of(dut: SkillSequencer, **values: list[float]):
    context = dut.CreateDefaultContext()
    for name, value in (GOOD | values).items():
        dut.GetInputPort(name).FixValue(context, value)
    return context


def outputs(dut: SkillSequencer, context) -> dict[str, float]:
    return {
        dut.get_output_port(i).get_name(): dut.get_output_port(i).Eval(context)[0]
        for i in range(dut.num_output_ports())
    }


def test_before_the_first_update_it_waits_with_an_open_hand(dut: SkillSequencer) -> None:
    assert outputs(dut, context_of(dut)) == {
        "phase": Phase.WAIT,
        "phase_start": 0.0,
        "fault": Fault.NONE,
        "width": SkillConfig().pregrasp_width,
        "holding": 0.0,
        "detect_request": 0.0,
    }


def test_an_update_equals_the_pure_function(dut: SkillSequencer) -> None:
    context = context_of(dut)
    before = dut.skill_state(context)
    seen = Observation(0.0, True, False, False, 0.5, 0.02, 0.2, False, False, 0.08, True)
    Simulator(dut, context).AdvanceTo(PERIOD / 2)
    assert np.array_equal(
        dut.skill_state(context), next_state(before, seen, SkillConfig()), equal_nan=True
    )


@pytest.mark.parametrize(
    ("bad", "fault"),
    [
        ({"safety_fault": [SafetyFault.EXTERNAL_TORQUE]}, Fault.SAFETY),
        ({"safety_fault": [np.nan]}, Fault.SAFETY),
        ({"width_measured": [np.nan]}, Fault.HAND_STATUS),
    ],
)
def test_what_makes_it_unsafe_to_go_on_is_a_fault(
    dut: SkillSequencer, bad: dict, fault: Fault
) -> None:
    context = context_of(dut, **bad)
    Simulator(dut, context).AdvanceTo(PERIOD / 2)
    assert outputs(dut, context)["phase"] == Phase.FAULT
    assert outputs(dut, context)["fault"] == fault


def test_nan_errors_are_no_progress(dut: SkillSequencer) -> None:
    context = context_of(dut, tau=[np.nan], mean_error=[np.nan])
    Simulator(dut, context).AdvanceTo(PERIOD / 2)
    state = dut.skill_state(context)
    assert (state.best_error, state.best_tau) == (np.inf, -np.inf)


def test_no_direct_feedthrough(dut: SkillSequencer) -> None:
    assert not dut.HasAnyDirectFeedthrough()
