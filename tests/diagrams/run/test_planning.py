from pathlib import Path

import numpy as np
import pytest

from poil_drake.diagrams.run.planning import PlanScenario
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.randomization import ObjectDirective
from poil_drake.errors import PlanningError, ScenarioError
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage


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


@pytest.mark.render
def test_an_object_that_nothing_places_is_refused(demonstration: Path) -> None:
    scenario = ChooseScenario()
    ObjectDirective(list(scenario.directives), "mug").default_free_body_pose = {}

    with pytest.raises(ScenarioError, match=r"'mug' starts \d+ mm inside 'panda::panda_link0::"):
        PlanScenario(scenario, demonstration)


def test_flying_pixels_are_no_obstacles_but_a_thin_rod_is() -> None:
    """A wall at 0.6 m, seen with pixels of 1 mm; a rod of 11 mm at 0.5 m before it."""
    depth = np.full((240, 320), 0.6, np.float32)
    depth[:, 150:163] = 0.5
    rng = np.random.default_rng(0)
    v, u = rng.integers(5, 235, 40), rng.integers(5, 140, 40)
    depth[v, u] -= 0.016  # Small enough a step not to count as an edge.
    K = np.array([[600.0, 0.0, 160.0], [0.0, 600.0, 120.0], [0.0, 0.0, 1.0]])
    camera = CameraModel("left", 320, 240, K, np.eye(4))
    image = RgbdImage(np.zeros((240, 320, 3), np.uint8), depth, 0.0)
    frame = MultiViewFrame((camera,), (image,))

    z = fuse_views(frame, [np.ones(depth.shape, bool)], FusionConfig().coarser()).points[:, 2]

    # Voxels of 4 mm average some of the pixels with the wall.
    assert not ((z > 0.51) & (z < 0.59)).any()
    rod = 0.2 / 0.004  # The rod's visible height, one point for each voxel along it.
    assert (z < 0.51).sum() > rod
