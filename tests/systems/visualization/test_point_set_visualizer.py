import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.visualization.meshcat_overlay import OVERLAY_PATH
from poil_drake.systems.visualization.point_set_visualizer import (
    PointSetVisualizer,
    PointSetVisualizerConfig,
)

VELOCITIES = ("angular_velocity", "linear_velocity")


@pytest.fixture
def reference():
    """Three points that move by 0.2 m along x in one second."""
    times = np.linspace(0.0, 1.0, 11)
    start = np.array([[0.0, 0.0, 0.1], [0.0, 0.1, 0.1], [0.0, 0.0, 0.2]])
    positions = start + 0.2 * times[:, None, None] * np.array([1.0, 0.0, 0.0])
    velocities = np.tile([0.2, 0.0, 0.0], (11, 3, 1))
    velocities[-1] = 0.0
    return PointTrajectory(times, positions, velocities)


@pytest.fixture
def dut(spy, reference):
    return PointSetVisualizer(meshcat=spy, reference=reference, phase_names=["wait", "follow"])


def publish(dut, **inputs):
    context = dut.CreateDefaultContext()
    for name, value in inputs.items():
        dut.GetInputPort(name).FixValue(context, value)
    dut.ForcedPublish(context)


def test_the_constructor_draws_the_reference_with_its_goal(spy, dut, reference):
    tubes = spy.objects["poil/reference/tubes"]

    assert tubes[:, 0].min() == pytest.approx(0.0, abs=0.002)
    assert tubes[:, 0].max() == pytest.approx(0.2, abs=0.002)
    for i, position in enumerate(reference.positions[-1]):
        np.testing.assert_allclose(spy.poses[f"poil/reference/goal/{i}"].translation(), position)
    assert spy.visible("poil/reference/goal")
    assert "poil" in spy.deleted, "older drawings"


@pytest.mark.parametrize(
    "inputs",
    [{}, {"gripper_pose": np.full(16, np.nan), "spatial_velocity": np.ones(6)}],
    ids=["no inputs", "a twist without a known gripper pose"],
)
def test_without_known_inputs_only_the_reference_is_visible(spy, dut, inputs):
    publish(dut, **inputs)

    for name in ("points", "target_points", "tracked_points", *VELOCITIES):
        assert not spy.visible(f"poil/{name}")
    assert not spy.visible(f"{OVERLAY_PATH}/phase")
    assert not spy.visible(f"{OVERLAY_PATH}/error")


def test_points_and_targets_are_drawn_at_their_input_positions(spy, dut):
    points = np.arange(9.0).reshape(3, 3)

    publish(dut, points=points.ravel(), target_points=-points.ravel())

    for i in range(3):
        np.testing.assert_array_equal(spy.poses[f"poil/points/{i}"].translation(), points[i])
        np.testing.assert_array_equal(
            spy.poses[f"poil/target_points/{i}"].translation(), -points[i]
        )
    assert spy.visible("poil/points")


def test_uncertain_points_look_different_and_unknown_ones_are_hidden(spy, dut):
    points = np.zeros((3, 3))
    points[2] = np.nan

    publish(dut, points=points.ravel(), confidence=[1.0, 0.0, 0.0])

    looks = [[spy.visible(f"poil/points/{i}/{look}") for look in (0, 1)] for i in range(3)]
    assert looks == [[True, False], [False, True], [False, False]]


def test_tracked_points_that_were_not_observed_are_hidden(spy, dut):
    positions = np.ones((3, 3))
    positions[1] = np.nan

    publish(dut, tracked_points=TrackedPoints(positions, np.array([1.0, 0.0, 1.0]), 0.0))

    assert [spy.visible(f"poil/tracked_points/{i}/0") for i in range(3)] == [True, False, True]


def test_the_twist_starts_at_the_gripper(spy, dut):
    X_WG = np.eye(4)
    X_WG[:3, 3] = [0.4, 0.1, 0.3]

    publish(dut, gripper_pose=X_WG.ravel(), spatial_velocity=[0, 0, 1.0, 0.1, 0, 0])

    for name, direction in zip(VELOCITIES, ([0, 0, 1], [1, 0, 0]), strict=True):
        X_WA = spy.poses[f"poil/{name}"]
        np.testing.assert_allclose(X_WA.translation(), [0.4, 0.1, 0.3])
        np.testing.assert_allclose(X_WA.rotation().col(2), direction, atol=1e-12)


def test_phase_and_error_are_shown(spy, dut):
    publish(dut, phase=[1.0], mean_error=[0.0123])

    assert spy.visible(f"{OVERLAY_PATH}/phase")
    assert [spy.visible(f"{OVERLAY_PATH}/phase/name/{i}") for i in range(2)] == [False, True]
    assert spy.visible(f"{OVERLAY_PATH}/error")
    assert spy.visible(f"{OVERLAY_PATH}/error/place_3/3")  # 12.3 mm


def test_all_motion_is_recorded_from_time_zero(spy, reference):
    config = PointSetVisualizerConfig(period=0.25, text_period=0.5)
    dut = PointSetVisualizer(meshcat=spy, reference=reference, config=config)
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    dut.GetInputPort("points").FixValue(context, np.zeros(9))
    dut.GetInputPort("confidence").FixValue(context, np.ones(3))
    spy.times.clear()

    simulator.AdvanceTo(0.5)

    assert spy.times["poil/points/0"] == [0.0, 0.25, 0.5]
    assert spy.times["poil/points", "visible"] == [0.0, 0.25, 0.5]
    assert spy.times["poil/points/0/1", "visible"] == [0.0, 0.5]
    assert None not in [time for times in spy.times.values() for time in times]


def test_publishing_draws_no_new_objects(spy, dut):
    before = dict(spy.objects)

    publish(dut, points=np.zeros(9))

    assert spy.objects == before
