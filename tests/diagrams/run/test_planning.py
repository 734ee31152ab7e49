from pathlib import Path

import pytest

from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.errors import PlanningError


@pytest.mark.render
def test_a_plan_respects_the_supervisors_box(demonstration: Path) -> None:
    # The gripper is 0.45 m above the robot's base at the start.
    scenario = ChooseScenario(
        data="{poil: {safety: {posture: {gripper_upper: [0.85, 0.85, 0.4]}}}}"
    )

    says = r"is outside .*gripper_upper\[2\], 0.4 m"
    with pytest.raises(PlanningError, match=says) as info:
        PlanScenario(scenario, demonstration)

    assert "poil.safety.posture" in info.value.remedy
