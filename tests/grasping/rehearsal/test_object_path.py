import numpy as np
import pytest
from numpy.testing import assert_allclose
from point_grids import point_grid

from poil_drake.geometry.scene_cloud import SceneCloud
from poil_drake.grasping.rehearsal.object_path import (
    LIFT_HEIGHT,
    PATH_STEP,
    ObjectPath,
    ObjectPathConfig,
    predict_object_path,
)
from poil_drake.robots.collision import CollisionConfig

NOTHING = np.zeros((0, 3))


def predict(mug, matching, obstacles: np.ndarray = NOTHING, **config: float) -> ObjectPath:
    return predict_object_path(
        matching,
        object_points=mug.cloud.points,
        part_points=mug.part_points,
        scene=SceneCloud(obstacles, ground_height=0.0),
        config=ObjectPathConfig(**config),
        collision=CollisionConfig(),
    )


def test_object_is_lifted_and_then_led_to_the_end(mug, matching):
    dut = predict(mug, matching)

    assert dut.converged
    assert_allclose(dut.X_W[0], np.eye(4))
    assert_allclose(dut.X_W[dut.lift_end, :3, 3], [0.0, 0.0, LIFT_HEIGHT])
    assert_allclose(dut.X_W[-1, :3, 3], [0.0, 0.2, 0.15], atol=0.004)
    assert_allclose(dut.X_W[-1, :3, :3], np.eye(3), atol=0.02)
    assert dut.excess == 0.0


def test_object_may_stand_on_the_table_at_the_start(mug, matching):
    assert mug.cloud.points[:, 2].min() < CollisionConfig().object_margin

    assert predict(mug, matching).excess == 0.0


def test_object_running_into_the_table_is_detected(mug, make_matching):
    down = make_matching(mug.part_points[::6], [0.1, 0.1, -0.02])

    dut = predict(mug, down)

    # Its bottom, 2 mm above the table at first, ends 18 mm below it.
    assert dut.excess > 0.015


def test_object_running_into_an_obstacle_is_detected(mug, matching):
    wall = point_grid(np.arange(0.35, 0.55, 0.003), 0.0, np.arange(0.01, 0.4, 0.003))

    assert predict(mug, matching, wall).excess > 0.003


def test_part_may_touch_the_fixture(mug, matching):
    # A rod through the handle at the goal: along y, where the handle's opening is.
    goal = mug.part_points.mean(axis=0) + np.array([-0.005, 0.2, 0.15])
    rod = goal + np.linspace(-0.05, 0.05, 60)[:, None] * [0.0, 1.0, 0.0]

    assert predict(mug, matching, rod).excess == 0.0


def test_arm_is_checked_at_limited_steps(mug, matching):
    dut = predict(mug, matching)

    assert dut.samples[0] == 0
    assert dut.samples[-1] == len(dut.X_W) - 1
    places = dut.X_W[dut.samples, :3, 3]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    # Plus one time step of the run: at most 0.25 m/s for 1/32 s.
    assert steps.max() < PATH_STEP + 0.25 / 32.0


def test_run_that_exceeds_the_time_limit_is_reported(mug, matching):
    dut = predict(mug, matching, max_time=0.5)

    assert not dut.converged


@pytest.mark.parametrize("height", [0.02, 0.1])
def test_lift_under_a_shelf_is_detected(mug, matching, height: float):
    top = mug.cloud.points[:, 2].max()
    shelf = point_grid(np.arange(0.40, 0.50, 0.004), np.arange(-0.15, -0.05, 0.004), top + height)

    dut = predict(mug, matching, shelf)

    # The lift is 60 mm; after it, the field leads away from under the higher shelf.
    assert (dut.excess > 0.003) == (height < 0.06)
