import pytest

from poil_drake.systems.skill.phases import PHASE_NAMES, Fault, Phase, phase_reason


def test_names_stand_at_their_phases_index() -> None:
    assert PHASE_NAMES[Phase.FOLLOW] == "follow"
    assert len(PHASE_NAMES) == len(Phase)


@pytest.mark.parametrize("phase", [p for p in Phase if p is not Phase.FAULT])
def test_every_phase_has_a_reason_of_its_own(phase: Phase) -> None:
    others = {phase_reason(p, 0) for p in Phase if p not in (phase, Phase.FAULT)}

    assert phase_reason(phase, 0) not in others | {""}


@pytest.mark.parametrize("fault", list(Fault))
def test_the_phase_fault_begins_because_of_the_fault(fault: Fault) -> None:
    assert phase_reason(float(Phase.FAULT), float(fault)) == fault.text
