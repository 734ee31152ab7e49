import dataclasses

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.diagrams.run.plan_validation import CheckPlanFits, surface_distance
from poil_drake.diagrams.scenario.load import LoadScenario, default_scenario_file
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import DetectionError, PlanningError
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.transfer.part_points import view_part

pytestmark = pytest.mark.render

POSE = np.array([0.47, -0.12, 0.0])
"""Where the package's scenario puts the mug [m], turned by 30 deg."""


def load(text: str = "{}") -> Scenario:
    return LoadScenario(filename=default_scenario_file(), data=text)


def moved(*, shift: tuple[float, float, float] = (0, 0, 0), turn: float = 0.0) -> Scenario:
    """Returns the scenario with the mug shifted [m] and turned [deg], and other noise."""
    scenario = load("{random_seed: 5}")
    pose = scenario.directives[-1].add_model.default_free_body_pose["body"]
    pose.translation = POSE + shift
    pose.rotation.value.deg = [0.0, 0.0, 30.0 + turn]
    return scenario


def steady(positions: np.ndarray) -> JointTrajectory:
    return JointTrajectory(np.array([0.0, 1.0]), np.array([positions] * 2), np.zeros((2, 7)))


@pytest.fixture(scope="module")
def plan() -> ExecutionPlan:
    """A plan that has seen the package's scenario; what it does with it is nothing."""
    station = MakeStation(load())
    context = station.CreateDefaultContext()
    view = view_part(
        CaptureFrame(station, context, labels=True),
        detector=LabelImageDetector(),
        object_label="mug",
        part_label="handle",
    )
    q = station.GetOutputPort("panda.position_measured").Eval(context)
    points = view.part.points[:5]
    return ExecutionPlan(
        object_label="mug",
        part_label="handle",
        target_points=points,
        object_points=view.whole.points,
        part_points=view.part.points,
        reference=PointTrajectory(
            np.array([0.0, 1.0]), np.array([points] * 2), np.zeros((2, 5, 3))
        ),
        grasp=GraspCandidate(np.eye(4), 0.01, 0.02, 1.0, np.zeros((2, 3))),
        approach=steady(q),
        descent=steady(q),
        lift_height=0.05,
        retreat_distance=0.1,
        nominal_posture=np.zeros(7),
    )


def test_a_plan_fits_the_scene_it_has_seen_with_other_noise(plan: ExecutionPlan) -> None:
    CheckPlanFits(plan, moved())


def test_a_plan_fits_where_a_millimetre_is_different(plan: ExecutionPlan) -> None:
    CheckPlanFits(plan, moved(shift=(0.001, -0.001, 0)))


@pytest.mark.parametrize(
    ("scenario", "says"),
    [
        (moved(shift=(0.01, 0, 0)), r"object 'mug' differs from what the plan saw: .* mm apart"),
        (moved(shift=(0, -0.15, 0)), "object 'mug' differs from what the plan saw"),
        # The body looks the same from all sides; the handle does not.
        (moved(turn=10), "part 'handle' of 'mug' differs from what the plan saw"),
    ],
    ids=["shifted by 1 cm", "shifted by 15 cm", "turned by 10 deg"],
)
def test_an_object_that_was_moved_is_noticed(
    plan: ExecutionPlan, scenario: Scenario, says: str
) -> None:
    with pytest.raises(PlanningError, match=says) as info:
        CheckPlanFits(plan, scenario)

    assert "plan again" in info.value.remedy


def test_another_object_is_noticed(plan: ExecutionPlan) -> None:
    scenario = load()
    scenario.directives[-1].add_model.file = "package://poil_drake/mugs/mug_c/mug_c.sdf"

    with pytest.raises(PlanningError, match="'mug' differs from what the plan saw"):
        CheckPlanFits(plan, scenario)


def test_an_object_that_is_out_of_sight_is_named(plan: ExecutionPlan) -> None:
    with pytest.raises(DetectionError, match="seen in no view"):
        CheckPlanFits(plan, moved(shift=(0, 0, -2.0)))


def test_an_arm_that_stands_elsewhere_is_noticed(plan: ExecutionPlan) -> None:
    scenario = load("{initial_position: {panda: {panda_joint3: [0.2]}}}")

    with pytest.raises(PlanningError, match=r"joint 3 is 0\.200 rad away.*initial_position"):
        CheckPlanFits(plan, scenario)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"object_label": "cup"}, "for the object 'cup', but poil.object is 'mug'"),
        ({"part_label": "rim"}, "for the part 'rim', but poil.part is 'handle'"),
    ],
)
def test_labels_must_agree(plan: ExecutionPlan, change: dict, says: str) -> None:
    with pytest.raises(PlanningError, match=says):
        CheckPlanFits(dataclasses.replace(plan, **change), load())


def test_without_cameras_nobody_looks(plan: ExecutionPlan) -> None:
    elsewhere = moved(shift=(0.1, 0, 0))
    truth = dataclasses.replace(elsewhere.poil, tracker="ground_truth")

    CheckPlanFits(plan, dataclasses.replace(elsewhere, cameras={}))
    CheckPlanFits(plan, dataclasses.replace(elsewhere, poil=truth))


def test_the_distance_of_parallel_planes_is_that_between_them() -> None:
    grid = np.stack(np.meshgrid(range(5), range(5), [0.0]), axis=-1).reshape(-1, 3).astype(float)

    assert surface_distance(grid, grid + np.array([0, 0, 0.25]), 1.0) == pytest.approx(0.25)


def test_the_larger_direction_counts_and_stray_points_do_not() -> None:
    line = np.arange(10.0)[:, None] * [1.0, 0.0, 0.0]
    half = line[:5]
    stray = np.vstack([line, [0.0, 0.0, 100.0]])

    # From the second half of the line it is 1, 2, ... 5 to the first.
    assert surface_distance(half, line, 1.0) == pytest.approx(1.5)
    assert surface_distance(line, stray, 10 / 11) == 0.0


def test_rigid_motions_leave_the_distance_alone() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(40, 3)), rng.normal(size=(30, 3))
    X = RigidTransform(RollPitchYaw(0.3, -0.2, 1.0), [1.0, 2.0, 3.0])

    before = surface_distance(first, second, 0.9)

    turned = surface_distance((X @ first.T).T, (X @ second.T).T, 0.9)
    assert turned == pytest.approx(before, abs=1e-12)
