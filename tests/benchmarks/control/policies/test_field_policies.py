import numpy as np
import pytest

from poil_drake.benchmarks.control.demonstration import (
    TaskDeformation,
    TaskDemonstration,
    TaskReference,
)
from poil_drake.benchmarks.control.policies.policies import (
    EntryPlanner,
    MakePolicy,
    TaskClouds,
    field_config,
    monitor_config,
)
from poil_drake.benchmarks.control.policies.policy import Observation
from poil_drake.control.entry.entry_monitor import EntryMonitorConfig
from poil_drake.control.entry.safe_entry import EntryKind
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm

TASK = "mug_insertion"


def observation(points, time=0.0, confidence=None):
    confidence = np.ones(len(points)) if confidence is None else confidence
    return Observation(time, points, confidence, *np.full((2, 4, 4), np.nan))


def test_field_policy_commands_the_field():
    points = TaskDemonstration(TASK).points[0] + np.array([0.02, -0.03, 0.01])
    dut = MakePolicy("field", TASK)

    tau, command = dut.step(dut.start(), observation(points))

    expected = point_set_bcsdm(points, TaskReference(TASK), BcsdmConfig())
    np.testing.assert_array_equal(command.V, expected.twist)
    np.testing.assert_array_equal(command.point, expected.centroid)
    assert tau == expected.tau


@pytest.mark.parametrize("name", ["field", "safe_entry"])
def test_unobserved_points_stop_the_object(name):
    points = TaskDemonstration(TASK).points[0]
    dut = MakePolicy(name, TASK)

    _, command = dut.step(dut.start(), observation(points * np.nan, confidence=np.zeros(10)))

    assert not command.V.any()


@pytest.mark.parametrize("name", ["field", "safe_entry"])
def test_policies_on_points_need_no_pose(name):
    points = TaskDemonstration(TASK).points[0]
    dut = MakePolicy(name, TASK)

    _, command = dut.step(dut.start(), observation(points))

    assert np.isfinite(command.V).all()
    assert command.V.any()


def test_safe_entry_plans_once_and_notes_it():
    points = TaskDemonstration(TASK).points[0]
    dut = MakePolicy("safe_entry", TASK)

    first, _ = dut.step(dut.start(), observation(points))
    second, _ = dut.step(first, observation(points, time=1 / 64))

    assert second.plan is first.plan
    assert dut.note(second).endswith("1 plans, following")


def test_clouds_are_the_scene_without_the_table_and_the_object():
    scene, body = TaskClouds(TASK)

    # The rack stands at (0.55, 0.30) and is 0.31 m high; the mug's start is at (0.45, -0.13).
    assert scene[:, 2].max() == pytest.approx(0.30, abs=0.02)
    assert np.hypot(*(scene[:, :2] - [0.55, 0.23]).T).max() < 0.2
    assert np.hypot(*(body[:, :2] - [0.45, -0.13]).T).max() < 0.1
    assert body[:, 2].min() == pytest.approx(0.005, abs=0.001)


def test_demonstration_is_free_until_the_handle_is_on_the_rod():
    model = EntryPlanner(TASK, 0.0).model

    # The handle passes the rod's tip in the last third of the way.
    assert 0.6 * len(model.poses) < model.contact < len(model.poses)


def test_reference_is_not_entered_in_contact_from_the_side():
    # From there the strap would come to lie below the rod, which clouds cannot tell from above.
    beside = TaskReference("hanging_bag").positions[-1] + np.array([-0.1, 0.0, -0.01])

    assert EntryPlanner("hanging_bag", 0.0).plan(beside).kind is not EntryKind.FIELD


def test_object_in_contact_continues_from_there():
    planner = EntryPlanner("hanging_bag", 0.0)
    places = TaskReference("hanging_bag").positions[planner.model.contact + 2]

    plan = planner.plan(places + np.array([0.0, 0.0, -0.005]))

    assert plan.kind is EntryKind.FIELD


def test_noise_and_deformation_widen_what_counts_as_an_outlier():
    rigid, soft = "pnp_cube", "hanging_bag"

    limits = [
        field_config(task, noise).inlier_distance
        for task, noise in ((rigid, 0.0), (rigid, 0.003), (soft, 0.0))
    ]

    assert limits[:2] == pytest.approx([0.005, 0.0152])
    assert limits[2] == pytest.approx(0.005 + TaskDeformation(soft))
    assert 0.003 < TaskDeformation(soft) < 0.008


def test_noise_and_deformation_raise_the_error_of_a_blocked_object():
    usual = EntryMonitorConfig().stall_error

    assert monitor_config("pnp_cube", 0.0).stall_error == usual
    # 1.5 * 1.6 * 3 mm.
    assert monitor_config("pnp_cube", 0.003).stall_error == pytest.approx(0.0072)
    deformation = TaskDeformation("hanging_bag")
    assert monitor_config("hanging_bag", 0.0).stall_error == pytest.approx(1.5 * deformation)
