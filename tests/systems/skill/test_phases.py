import pytest

from poil_drake.systems.skill.phases import PHASE_NAMES, Fault, Phase, phase_reason


def test_each_phase_has_its_name_and_its_own_reason() -> None:
    reasons = {phase_reason(phase, 0) for phase in Phase}

    assert PHASE_NAMES[Phase.FOLLOW] == "follow"
    assert len(reasons) == len(PHASE_NAMES) == len(Phase)
    assert "" not in reasons


@pytest.mark.parametrize("fault", list(Fault))
def test_the_reason_of_the_phase_fault_is_the_fault(fault: Fault) -> None:
    assert phase_reason(float(Phase.FAULT), float(fault)) == fault.text != ""
