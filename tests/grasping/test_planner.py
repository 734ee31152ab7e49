from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from poil_drake.errors import NoFeasibleGraspError, PlanningError
from poil_drake.grasping.candidates.grasp_candidate import GraspSamplingConfig
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.planner import PlannerConfig, plan_execution
from poil_drake.grasping.rehearsal.feasibility import FeasibilityConfig
from poil_drake.grasping.rehearsal.selection import SelectionConfig
from poil_drake.robots.collision import RobotCollisionChecker, SceneCloud
from poil_drake.robots.panda_spheres import make_robot_spheres
from poil_drake.robots.posture_guard import PostureGuard, PostureGuardConfig

CONFIG = PlannerConfig(sampling=GraspSamplingConfig(seed_points=60))  # enough, in less time
HOME = np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.6, np.pi / 4])


def screen() -> np.ndarray:
    """A low screen to the robot's left, and a piece of the table."""
    x, z = np.meshgrid(np.arange(0.3, 0.7, 0.01), np.arange(0.0, 0.15, 0.01))
    upright = np.stack([x.ravel(), np.full(x.size, 0.3), z.ravel()], axis=1)
    grid = np.stack(np.meshgrid(np.arange(0.2, 0.8, 0.01), np.arange(-0.4, 0.4, 0.01)), -1)
    flat = grid.reshape(-1, 2)
    return np.concatenate([upright, np.column_stack([flat, np.zeros(len(flat))])])


def make_plan(mug, matching, model, scene_points: np.ndarray, **options) -> ExecutionPlan:
    return plan_execution(
        [matching],
        object_label="mug",
        part_label="handle",
        object_cloud=mug.cloud,
        part_points=mug.part_points,
        scene_points=scene_points,
        q_start=HOME,
        model=model,
        **({"config": CONFIG} | options),
    )


@pytest.fixture(scope="module")
def plan(mug, matching, model) -> ExecutionPlan:
    # The cameras see the object and the robot as well.
    robot = model.link_poses(HOME)[3:, :3, 3]
    seen = np.concatenate([screen(), mug.cloud.points + 0.001, robot])
    return make_plan(mug, matching, model, seen, metadata={"scenario": "test"})


def test_motions_join_home_pregrasp_and_grasp(plan, model):
    pregrasp = model.gripper_pose(plan.descent.positions[0])
    grasp = model.gripper_pose(plan.descent.positions[-1])

    assert_allclose(plan.approach.positions[0], HOME, atol=1e-9)
    assert_allclose(plan.approach.positions[-1], plan.descent.positions[0], atol=1e-9)
    assert_allclose(pregrasp, plan.grasp.pregrasp_pose(0.1), atol=2e-3)
    assert_allclose(grasp, plan.grasp.X_WG, atol=2e-3)


def test_descent_is_straight(plan, model):
    positions = model.gripper_pose(plan.descent.positions)[:, :3, 3]

    offsets = positions - plan.grasp.X_WG[:3, 3]
    along = offsets @ plan.grasp.approach
    across = offsets - along[:, None] * plan.grasp.approach
    assert np.linalg.norm(across, axis=1).max() < 2e-3
    assert np.all(np.diff(along) > -1e-4)


def test_approach_keeps_clear_of_scene_and_object(plan, mug, model):
    dut = RobotCollisionChecker(
        model=model,
        spheres=make_robot_spheres(finger_opening=plan.pregrasp_width),
        scene=SceneCloud(np.concatenate([screen(), mug.cloud.points])),
    )

    assert dut.clearance(plan.approach.positions).min() > 0.0


def boxed(**box) -> PlannerConfig:
    feasibility = FeasibilityConfig(posture=PostureGuardConfig(**box))
    return replace(CONFIG, selection=SelectionConfig(feasibility=feasibility))


def test_all_planned_motions_keep_to_the_box(mug, matching, model, plan):
    # The arm stands 1 cm from the one face; the way found without a box is 14 mm from the other.
    box = {"gripper_lower": (model.gripper_pose(HOME)[0, 3] - 0.01, -0.155, -1.0)}
    guard = PostureGuard(model=model, config=PostureGuardConfig(**box))
    free = guard.face_distances(plan.approach.positions).min(axis=0)
    assert free.min() < 0.015

    dut = make_plan(mug, matching, model, screen(), config=boxed(**box))

    least = np.minimum(0.018, guard.face_distances(HOME[None])[0])
    assert least[0] == pytest.approx(0.01)
    # Between the postures that are checked, the way bulges by less than a millimetre.
    for motion in (dut.approach, dut.descent):
        assert np.all(guard.face_distances(motion.positions) >= least - 1e-3)


def test_an_arm_outside_its_box_is_told_before_grasps_are_sought(mug, matching, model):
    told: list[str] = []
    height = model.gripper_pose(HOME)[2, 3]

    with pytest.raises(PlanningError, match=r"stands outside .*gripper_upper\[2\].* 5.0 mm"):
        make_plan(
            mug,
            matching,
            model,
            screen(),
            config=boxed(gripper_upper=(0.85, 0.85, height - 0.005)),
            progress=lambda what, share: told.append(what),
        )

    assert not told


def test_what_the_plan_came_from_is_noted(plan):
    assert plan.metadata["scenario"] == "test"
    assert plan.metadata["seed"] == 0
    assert plan.metadata["feasible_pairs"] >= 1
    assert (plan.object_label, plan.part_label) == ("mug", "handle")


def test_same_input_gives_the_same_bits(plan, mug, matching, model):
    robot = model.link_poses(HOME)[3:, :3, 3]
    seen = np.concatenate([screen(), mug.cloud.points + 0.001, robot])

    again = make_plan(mug, matching, model, seen)

    assert_array_equal(again.grasp.X_WG, plan.grasp.X_WG)
    assert_array_equal(again.approach.positions, plan.approach.positions)
    assert_array_equal(again.descent.positions, plan.descent.positions)


def test_progress_is_told(mug, matching, model):
    told: list[tuple[str, float]] = []

    make_plan(
        mug, matching, model, screen(), progress=lambda what, share: told.append((what, share))
    )

    assert next(what for what, _ in told) == "sampling grasps"
    assert {"rehearsing grasps", "planning the approach"} <= {what for what, _ in told}
    assert all(0.0 <= share <= 1.0 for _, share in told)


def test_caged_object_is_reported(mug, matching, model):
    grid = np.stack(np.meshgrid(np.arange(0.35, 0.55, 0.004), np.arange(-0.2, 0.0, 0.004)), -1)
    flat = grid.reshape(-1, 2)
    lid = np.column_stack([flat, np.full(len(flat), mug.height + 0.02)])

    with pytest.raises(NoFeasibleGraspError, match="No grasp was found"):
        make_plan(mug, matching, model, lid)
