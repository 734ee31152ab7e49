import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from point_grids import point_grid

from poil_drake.errors import NoFeasibleGraspError, PlanningError
from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.candidates.grasp_candidate import GraspSamplingConfig
from poil_drake.grasping.planner import PlannerConfig
from poil_drake.grasping.rehearsal.rehearsal import FeasibilityConfig
from poil_drake.robots.collision import RobotCollisionChecker
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.robots.posture_guard import PostureGuard, PostureGuardConfig
from poil_drake.runtime.worker_executor import WorkerExecutor


def test_motions_join_home_pregrasp_and_grasp(plan, model, home):
    pregrasp = plan.grasp.X_WG.copy()
    pregrasp[:3, 3] -= 0.1 * pregrasp[:3, 2]

    assert_allclose(plan.approach.positions[0], home, atol=1e-9)
    assert_allclose(plan.approach.positions[-1], plan.descent.positions[0], atol=1e-9)
    poses = model.gripper_pose(plan.descent.positions[[0, -1]])
    assert_allclose(poses, [pregrasp, plan.grasp.X_WG], atol=2e-3)


def test_descent_is_straight(plan, model):
    positions = model.gripper_pose(plan.descent.positions)[:, :3, 3]

    offsets = positions - plan.grasp.X_WG[:3, 3]
    along = offsets @ plan.grasp.X_WG[:3, 2]
    across = offsets - along[:, None] * plan.grasp.X_WG[:3, 2]
    assert np.linalg.norm(across, axis=1).max() < 2e-3
    assert np.all(np.diff(along) > -1e-4)


def test_approach_keeps_clear_of_scene_and_object(plan, mug, model, screen):
    dut = RobotCollisionChecker(
        model=model,
        spheres=make_robot_spheres(finger_opening=plan.pregrasp_width),
        scene=SceneCloud(np.concatenate([screen, mug.cloud.points]), ground_height=0.0),
    )

    assert dut.smallest_clearance(plan.approach.positions) > 0.0


def boxed(**box) -> PlannerConfig:
    feasibility = FeasibilityConfig(posture=PostureGuardConfig(**box))
    return PlannerConfig(sampling=GraspSamplingConfig(seed_points=60), feasibility=feasibility)


def test_all_planned_motions_stay_inside_the_box(make_plan, model, plan, screen, home):
    # The arm starts 1 cm from one face; the path found without boxes comes within 14 mm of another.
    box = {"gripper_lower": (model.gripper_pose(home)[0, 3] - 0.01, -0.155, -1.0)}
    guard = PostureGuard(model=model, config=PostureGuardConfig(**box))
    free = guard.face_distances(plan.approach.positions).min(axis=0)
    assert free.min() < 0.015

    dut = make_plan(screen, config=boxed(**box)).plan

    least = np.minimum(0.018, guard.face_distances(home[None])[0])
    assert least[0] == pytest.approx(0.01)
    # Between checked postures, the path bulges by less than a millimetre.
    for motion in (dut.approach, dut.descent):
        assert np.all(guard.face_distances(motion.positions) >= least - 1e-3)


def test_an_arm_outside_its_box_is_rejected_before_sampling(make_plan, model, screen, home):
    reported: list[str] = []
    height = model.gripper_pose(home)[2, 3]

    with pytest.raises(PlanningError, match=r"is outside .* 5.0 mm beyond .*gripper_upper\[2\]"):
        make_plan(
            screen,
            config=boxed(gripper_upper=(0.85, 0.85, height - 0.005)),
            progress=lambda what, share: reported.append(what),
        )

    assert not reported


def test_metadata_contains_the_origin_of_the_plan(plan):
    assert plan.metadata["scenario"] == "test"
    assert plan.metadata["seed"] == 0
    assert plan.metadata["feasible_pairs"] >= 1
    assert (plan.object_label, plan.part_label) == ("mug", "handle")


def test_a_worker_does_not_change_the_plan_and_progress_is_reported(plan, make_plan, seen):
    reported: list[tuple[str, float]] = []

    with WorkerExecutor() as worker:
        again = make_plan(
            seen, executor=worker, progress=lambda what, share: reported.append((what, share))
        ).plan

    assert_array_equal(again.grasp.X_WG, plan.grasp.X_WG)
    assert_array_equal(again.approach.positions, plan.approach.positions)
    assert_array_equal(again.descent.positions, plan.descent.positions)
    stages = list(dict.fromkeys(what for what, _ in reported))
    assert stages == ["sampling grasps", "rehearsing grasps", "planning the approach"]
    assert all(0.0 <= share <= 1.0 for _, share in reported)


def test_result_holds_what_the_plan_was_chosen_from(planned, screen):
    assert planned.choice.candidate is planned.plan.grasp
    assert any(grasp is planned.plan.grasp for grasp in planned.feasible)
    counts = len(planned.feasible), len(planned.feasible) + len(planned.rejected)
    metadata = planned.plan.metadata
    assert counts == (metadata["feasible_pairs"], metadata["candidates"])
    # Only points of the screen remain: those of table, object and robot are not obstacles.
    upright = {tuple(point) for point in screen.tolist() if point[2] > 0.0}
    assert {tuple(point) for point in planned.scene_points.tolist()} <= upright


def test_rejects_an_object_without_free_grasps(make_plan, mug):
    lid = point_grid(np.arange(0.35, 0.55, 0.004), np.arange(-0.2, 0.0, 0.004), mug.height + 0.02)

    with pytest.raises(NoFeasibleGraspError, match="No grasp was found"):
        make_plan(lid)
