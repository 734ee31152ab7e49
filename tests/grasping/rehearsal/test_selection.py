import re
from dataclasses import replace

import numpy as np
import pytest
from point_grids import point_grid

from poil_drake.errors import NoFeasibleGraspError
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.rehearsal.object_path import ObjectPathConfig, predict_object_path
from poil_drake.grasping.rehearsal.rehearsal import Failure, FeasibilityChecker, FeasibilityConfig
from poil_drake.grasping.rehearsal.selection import GraspChoice, rank_grasps
from poil_drake.robots.inverse_kinematics import distinct_solutions
from poil_drake.robots.posture_guard import PostureGuardConfig

NOTHING = np.zeros((0, 3))
DOWN = np.diag([1.0, -1.0, -1.0])


def top_grasp(place: np.ndarray, score: float = 0.8) -> GraspCandidate:
    contacts = place + np.array([[0.0, -0.002, 0.0], [0.0, 0.002, 0.0]])
    return GraspCandidate(make_transform(DOWN, place), 0.004, 0.028, score, contacts)


@pytest.fixture
def grasps(mug) -> list[GraspCandidate]:
    """From above, across the wall of the rim, on either side of the mug."""
    rim = mug.height - 0.006
    return [top_grasp(mug.center + np.array([0.0, y, rim])) for y in (0.038, -0.038)]


@pytest.fixture
def rank(mug, model):
    def rank(grasps, matchings, obstacles=NOTHING, feasibility=None) -> list[GraspChoice]:
        return rank_grasps(
            grasps,
            matchings,
            model=model,
            scene=SceneCloud(obstacles, ground_height=0.0),
            object_points=mug.cloud.points,
            part_points=mug.part_points,
            feasibility=feasibility,
        )

    return rank


def test_chosen_grasp_is_rehearsed_from_pregrasp_to_retreat(rank, grasps, matching, model):
    dut = rank(grasps, [matching])[0]

    finding = dut.feasibility
    assert finding.failure is None
    assert np.isfinite(finding.cost)
    positions = [
        model.gripper_pose(q)[:3, 3]
        for q in (finding.q_approach[0], finding.q_approach[-1], finding.q_carry[-1])
    ]
    grasp = dut.candidate.X_WG[:3, 3]
    # 10 cm above, at the grasp, and carried 0.2 m to the left and 0.15 m up.
    np.testing.assert_allclose(positions[0], grasp + np.array([0.0, 0.0, 0.1]), atol=0.002)
    np.testing.assert_allclose(positions[1], grasp, atol=0.002)
    np.testing.assert_allclose(positions[2], grasp + np.array([0.0, 0.2, 0.15]), atol=0.005)
    assert finding.clearance > 0.0


def test_better_score_wins_between_like_grasps(rank, grasps, matching):
    worse = replace(grasps[0], score=0.1)

    dut = rank([worse, grasps[0]], [matching])[0]

    assert dut.candidate is grasps[0]


# Under the shelf over the goal there is space for the mug, but not for the hand above it.
SHELF = point_grid(np.arange(0.35, 0.55, 0.01), np.arange(0.06, 0.2, 0.01), 0.33)
WALL = point_grid(np.arange(0.35, 0.55, 0.004), 0.0, np.arange(0.01, 0.2, 0.004))


@pytest.mark.parametrize(
    ("obstacle", "says", "remedy"),
    [
        (SHELF, "2 bring the robot into collision", "Clear the space"),
        (WALL, "2 bring the object into collision", "fixture"),
    ],
)
def test_collisions_are_counted(rank, grasps, matching, obstacle, says, remedy):
    with pytest.raises(NoFeasibleGraspError, match=says) as info:
        rank(grasps, [matching], obstacle)
    assert remedy in info.value.remedy


def within(**box) -> FeasibilityConfig:
    return FeasibilityConfig(posture=PostureGuardConfig(**box))


def test_a_grasp_that_stays_in_the_box_is_chosen(rank, grasps, matching):
    # 0.2 m to the left, the grasps end at y = 0.138 m and y = 0.062 m; 2 cm are kept.
    dut = rank(grasps, [matching], feasibility=within(gripper_upper=(0.85, 0.1, 1.2)))[0]

    assert dut.candidate is grasps[1]


def test_grasps_that_leave_the_box_are_counted_and_the_face_is_named(rank, grasps, matching):
    with pytest.raises(
        NoFeasibleGraspError, match="2 come too close to a face of the workspace"
    ) as info:
        rank(grasps, [matching], feasibility=within(gripper_upper=(0.85, 0.07, 1.2)))

    found = re.search(
        r"best case, the gripper is (\S+) mm from \S+gripper_upper\[1\], 0.07 m", str(info.value)
    )
    assert found is not None
    assert float(found[1]) == pytest.approx(8.0, abs=2.0)
    assert "poil.safety.posture" in info.value.remedy


def test_the_error_is_about_the_best_configuration_of_the_arm(rank, mug, model, grasps, matching):
    # In one of the arm's configurations, the elbow leaves the box by less than in others.
    feasibility = within(body_upper=(1.1, 0.1, 1.5))
    checker = FeasibilityChecker(
        model=model, scene=SceneCloud(NOTHING, ground_height=0.0), config=feasibility
    )
    path = predict_object_path(
        matching,
        object_points=mug.cloud.points,
        part_points=mug.part_points,
        scene=SceneCloud(NOTHING, ground_height=0.0),
        config=ObjectPathConfig(),
        collision=feasibility.collision,
    )
    configurations = distinct_solutions(model, np.array([grasp.X_WG for grasp in grasps]))
    findings = checker.rehearse(grasps, configurations, path)
    outside = [f.workspace_clearance for f in findings if f.failure is Failure.WORKSPACE]
    assert len(set(outside)) > 2

    with pytest.raises(NoFeasibleGraspError, match="2 come too close") as info:
        rank(grasps, [matching], feasibility=feasibility)

    assert f"{-1e3 * max(outside):.1f} mm beyond" in str(info.value)


def test_feasible_matching_is_chosen(rank, grasps, matching, mug, make_matching):
    away = make_matching(mug.part_points[::6], [0.6, 0.0, 0.2])

    assert {choice.matching for choice in rank(grasps, [away, matching])} == {1}


@pytest.mark.parametrize(
    ("count", "says"),
    [(1, "None of the 2 grasps is feasible: 2 leave"), (2, "feasible under any of the 2 match")],
)
def test_goal_out_of_reach_is_counted(rank, grasps, mug, make_matching, count: int, says: str):
    away = make_matching(mug.part_points[::6], [0.6, 0.0, 0.2])

    with pytest.raises(NoFeasibleGraspError, match=says):
        rank(grasps, [away] * count)


def test_grasps_out_of_reach_are_counted(rank, matching):
    far = [top_grasp(np.array([1.4, 0.1 * k, 0.1])) for k in range(3)]

    with pytest.raises(NoFeasibleGraspError, match="3 are out of the arm's reach") as info:
        rank(far, [matching])
    assert "Move the object" in info.value.remedy


def test_no_grasp_at_all_is_explained(rank, matching):
    with pytest.raises(NoFeasibleGraspError, match="No grasp was found on the object"):
        rank([], [matching])


def test_grasps_of_all_batches_are_rehearsed_and_ranked_by_cost(rank, grasps, matching):
    # 26 grasps make two rounds of two batches each.
    costs = [choice.feasibility.cost for choice in rank(grasps * 13, [matching])]

    pair = [choice.feasibility.cost for choice in rank(grasps, [matching])]
    np.testing.assert_array_equal(costs, np.repeat(sorted(pair), 13))
