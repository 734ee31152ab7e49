import dataclasses

import numpy as np
import pytest
from labelled_frames import exact_masks
from short_skill import short_plan

from poil_drake.diagrams.run.plan_validation import CheckPlanFits, surface_distance
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import DetectionError, PlanningError
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.transfer.part_points import view_part

pytestmark = pytest.mark.render

POSE = np.array([0.47, -0.12, 0.0])
"""Position [m] of the mug in the package's scenario, where it is turned by 30 deg."""


def changed(
    *, shift: tuple[float, float, float] = (0, 0, 0), turn: float = 0.0, mug: str = "mug_a"
) -> Scenario:
    """Returns the scenario with a mug that is shifted [m] and turned [deg], and other noise."""
    scenario = ChooseScenario(data="{random_seed: 5}")
    model = scenario.directives[-1].add_model
    model.file = f"package://poil_drake/mugs/{mug}/{mug}.sdf"
    pose = model.default_free_body_pose["body"]
    pose.translation = POSE + shift
    pose.rotation.value.deg = [0.0, 0.0, 30.0 + turn]
    return scenario


@pytest.fixture(scope="module")
def plan() -> ExecutionPlan:
    """A plan whose arm and object are those of the package's scenario."""
    station = MakeStation(ChooseScenario())
    context = station.CreateDefaultContext()
    frame = CaptureFrame(station, context, labels=True)
    view = view_part(frame, exact_masks(frame))
    q = station.GetOutputPort("panda.position_measured").Eval(context)
    approach = JointTrajectory([0.0, 1.0], [q, q], np.zeros((2, 7)))
    return dataclasses.replace(
        short_plan(),
        object_points=view.whole.points,
        part_points=view.part.points,
        approach=approach,
    )


@pytest.mark.parametrize("shift", [(0, 0, 0), (0.001, -0.001, 0)])
def test_a_plan_fits_the_same_scene_with_other_noise(
    plan: ExecutionPlan, shift: tuple[float, float, float]
) -> None:
    CheckPlanFits(plan, changed(shift=shift))


@pytest.mark.parametrize(
    ("scenario", "says"),
    [
        (changed(shift=(0.01, 0, 0)), r"object 'mug' .* mm from the surface in the plan"),
        (changed(shift=(0, -0.15, 0)), "object 'mug' does not match the plan"),
        # The body is round; the handle is not.
        (changed(turn=10), "part 'handle' of 'mug' does not match the plan"),
        (changed(mug="mug_c"), "'mug' does not match the plan"),
        (
            ChooseScenario(data="{initial_position: {panda: {panda_joint3: [0.2]}}}"),
            r"joint 3 is 0\.200 rad away.*initial_position",
        ),
    ],
    ids=["shifted by 1 cm", "shifted by 15 cm", "turned by 10 deg", "another mug", "arm moved"],
)
def test_a_changed_scene_is_an_error(plan: ExecutionPlan, scenario: Scenario, says: str) -> None:
    with pytest.raises(PlanningError, match=says) as info:
        CheckPlanFits(plan, scenario)

    assert "plan again" in info.value.remedy


def test_an_object_out_of_sight_is_an_error(plan: ExecutionPlan) -> None:
    with pytest.raises(DetectionError, match=r"None of the \d objects on the table"):
        CheckPlanFits(plan, changed(shift=(0, 0, -2.0)))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"object_label": "cup"}, "for the object 'cup', but poil.object is 'mug'"),
        ({"part_label": "rim"}, "for the part 'rim', but poil.part is 'handle'"),
    ],
)
def test_labels_must_agree(plan: ExecutionPlan, change: dict, says: str) -> None:
    with pytest.raises(PlanningError, match=says):
        CheckPlanFits(dataclasses.replace(plan, **change), ChooseScenario())


def test_without_cameras_the_object_is_not_checked(plan: ExecutionPlan) -> None:
    elsewhere = changed(shift=(0.1, 0, 0))
    truth = dataclasses.replace(elsewhere.poil, tracker="ground_truth")

    CheckPlanFits(plan, dataclasses.replace(elsewhere, cameras={}))
    CheckPlanFits(plan, dataclasses.replace(elsewhere, poil=truth))


def test_the_distance_of_parallel_planes() -> None:
    grid = np.stack(np.meshgrid(range(5), range(5), [0.0]), axis=-1).reshape(-1, 3).astype(float)

    assert surface_distance(grid, grid + np.array([0, 0, 0.25])) == pytest.approx(0.25)


def test_the_larger_direction_counts_and_outliers_do_not() -> None:
    line = np.arange(10.0)[:, None] * [1.0, 0.0, 0.0]
    half = line[:5]
    stray = np.vstack([line, [0.0, 0.0, 100.0]])

    # The points of the second half are 1, 2, ... 5 away from the first; the farthest is left out.
    assert surface_distance(half, line) == pytest.approx((1 + 2 + 3 + 4) / 9)
    assert surface_distance(line, stray) == 0.0
