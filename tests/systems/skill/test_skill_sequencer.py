import numpy as np
import pytest
from system_bench import SystemBench

from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import Fault, Phase
from poil_drake.systems.skill.sequencer import SkillSequencer
from poil_drake.systems.skill.state_machine import Observation, SkillConfig, next_state
from poil_drake.systems.statuses import ControllerStatus, IkStatus, TrackerStatus

GOOD = {
    "tracker_status": TrackerStatus.TRACKING,
    "controller_status": ControllerStatus.OK,
    "tau": 0.5,
    "mean_error": 0.02,
    "goal_error": 0.2,
    "motion_done": 0.0,
    "ik_status": IkStatus.OK,
    "width_measured": 0.08,
    "safety_fault": SafetyFault.NONE,
}


def make_bench(**changed: float) -> SystemBench:
    return SystemBench(SkillSequencer(), **(GOOD | changed))


def test_before_the_first_update_it_waits_with_an_open_hand() -> None:
    bench = make_bench()

    outputs = {
        "phase": Phase.WAIT,
        "phase_start": 0.0,
        "fault": Fault.NONE,
        "width": SkillConfig().open_width,
        "holding": 0.0,
        "detect_request": 0.0,
    }
    assert {name: bench.read(name)[0] for name in outputs} == outputs
    assert not bench.dut.HasAnyDirectFeedthrough()


def test_an_update_equals_the_pure_function() -> None:
    bench = make_bench()
    before = bench.dut.skill_state(bench.context)
    # The controller's inputs count in FOLLOW only.
    observation = Observation(
        0.0, True, False, False, np.nan, np.nan, np.nan, False, False, 0.08, True
    )

    bench.advance_to(1 / 512)

    np.testing.assert_array_equal(
        bench.dut.skill_state(bench.context), next_state(before, observation, SkillConfig())
    )


@pytest.mark.parametrize(
    ("bad", "fault"),
    [
        ({"safety_fault": SafetyFault.EXTERNAL_TORQUE}, Fault.SAFETY),
        ({"safety_fault": np.nan}, Fault.SAFETY),
        ({"width_measured": np.nan}, Fault.HAND_STATUS),
    ],
)
def test_an_unsafe_input_is_a_fault(bad: dict, fault: Fault) -> None:
    bench = make_bench(**bad)

    bench.advance_to(1 / 512)

    assert (bench.read("phase")[0], bench.read("fault")[0]) == (Phase.FAULT, fault)
