"""The object of a simulated station starts on something, and inside nothing."""

import numpy as np
import pytest
from moved_scene import moved
from own_models import own_scenario

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation, RequireFreeStart
from poil_drake.errors import ScenarioError

FREE_BOARD = (
    "{add_model: {name: board, file: 'package://poil_drake/fixtures/table.sdf', "
    "default_free_body_pose: {table: {translation: [3, 3, 0]}}}}"
)


@pytest.mark.parametrize(
    ("height", "options", "says"),
    [
        (-0.03, {}, r"model 'mug' starts \d\d mm inside 'table::"),
        (0.03, {}, "model 'mug' starts in the air: .* 5 mm below"),
        # In the robot's base, where models without a pose or a weld are.
        (0.0, {"pose_of": ""}, "model 'mug' starts .* inside 'panda::panda_link0::"),
        (0.0, {"weld_rack": ""}, "model 'rack' starts .* inside 'panda::panda_link0::"),
        (0.0, {"more": FREE_BOARD}, "model 'board' starts in the air"),
    ],
)
def test_a_start_that_is_not_free_is_refused(height: float, options: dict, says: str) -> None:
    text = own_scenario(**options).replace("-0.12, 0.0]", f"-0.12, {height}]")
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
