"""The object of a simulated station starts on something, and inside nothing."""

import numpy as np
import pytest
from moved_scene import moved
from own_models import PACKAGE_MUG, own_scenario

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation, RequireFreeStart
from poil_drake.errors import ScenarioError

POSE = "{body: {translation: [0.47, -0.12, 0.0]}}"
LOW, HIGH = (POSE.replace("0.0]", f"{z}]") for z in (-0.03, 0.03))


@pytest.mark.parametrize(
    ("pose", "weld_rack", "says"),
    [
        (LOW, "rack::stand", r"'mug' starts \d\d mm inside 'table::"),
        (HIGH, "rack::stand", r"'mug' .*air.*5 mm below"),
        # In the robot's base, where models without a pose or a weld are.
        ("{}", "rack::stand", r"object 'mug' starts .* inside 'panda::panda_link0::"),
        (POSE, "", r"fixture 'rack' starts .* inside 'panda::panda_link0::"),
    ],
)
def test_a_start_that_is_not_free_is_refused(pose: str, weld_rack: str, says: str) -> None:
    text = own_scenario(more=PACKAGE_MUG.replace(POSE, pose), weld_rack=weld_rack)
    station = MakeStation(ChooseScenario(data=text), cameras=False)

    with pytest.raises(ScenarioError, match=f"{says}.*default_free_body_pose or add_weld"):
        RequireFreeStart(station)


@pytest.mark.parametrize("height", [0.0, 0.004, 0.75])
def test_an_object_may_start_a_little_above_its_support(scenario: Scenario, height: float) -> None:
    raised = moved(scenario, height=height, yaw=30.0)
    mug = raised.directives[-1].add_model
    pose = mug.default_free_body_pose["body"]
    pose.translation = np.add(pose.translation, [0.0, 0.0, 0.004])
    mug.default_free_body_pose = {"body": pose}

    RequireFreeStart(MakeStation(raised, cameras=False))
