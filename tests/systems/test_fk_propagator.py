from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from system_bench import SystemBench

from poil_drake.errors import InvalidValueError
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.fk_propagator import (
    FkPropagator,
    empty_history,
    motion_at,
    record_motion,
)
from poil_drake.systems.ik.arm_kinematics import ArmKinematics

PERIOD = 1 / 256
P_G = np.array([[0.02, 0.0, 0.05], [0.0, 0.03, 0.06], [-0.02, -0.01, 0.08], [0.01, 0.02, 0.04]])
N = len(P_G)


def joints(time: float) -> np.ndarray:
    return np.array([0.8 * np.sin(2.0 * time), 0.5 * time - 0.3])


def gripper_pose(q: np.ndarray) -> np.ndarray:
    """X_WG of the two-joint arm, by hand."""
    R_turn = Rotation.from_rotvec([0.0, 0.0, q[0]]).as_matrix()
    R_tilt = Rotation.from_rotvec([0.0, q[1], 0.0]).as_matrix()
    X = np.eye(4)
    X[:3, :3] = R_turn @ R_tilt
    X[:3, 3] = R_turn @ (np.array([0.4, 0.0, 0.0]) + R_tilt @ [0.3, 0.0, 0.0])
    return X


def held_points(time: float) -> np.ndarray:
    X_WG = gripper_pose(joints(time))
    return P_G @ X_WG[:3, :3].T + X_WG[:3, 3]


def seen(positions: np.ndarray, stamp: float) -> TrackedPoints:
    return TrackedPoints(positions, np.ones(N), stamp)


def assert_held(bench: "ArmBench", tick: int) -> None:
    """Checks that the points are where the hand held them at a tick."""
    truth = held_points(tick * PERIOD)
    np.testing.assert_allclose(bench.points(), truth, rtol=0.0, atol=1e-9)


class ArmBench(SystemBench):
    """Feeds the dut joint positions, tick by tick."""

    def step(self, q: np.ndarray) -> None:
        """Runs the update of the current tick."""
        self.fix("position_measured", q)
        self.advance(PERIOD)

    def step_to(self, tick: int, q: Callable[[float], np.ndarray] = joints) -> None:
        while self.time < tick * PERIOD:
            self.step(q(self.time))

    def points(self) -> np.ndarray:
        return self.read("points").reshape(-1, 3)


def make_bench(arm: ArmKinematics, max_age: float = 0.5) -> ArmBench:
    dut = FkPropagator(num_points=N, kinematics=arm, period=PERIOD, max_age=max_age)
    return ArmBench(dut, tracked_points=TrackedPoints.lost(N, -np.inf), holding=1.0)


@pytest.fixture
def bench(two_joint_arm: ArmKinematics) -> ArmBench:
    return make_bench(two_joint_arm)


def assert_no_points(bench: ArmBench) -> None:
    assert np.all(np.isnan(bench.points()))
    assert np.all(bench.read("confidence") == 0.0)
    assert bench.read("age") == np.inf


def test_before_the_first_track_only_the_gripper_is_known(bench: ArmBench) -> None:
    assert_no_points(bench)
    assert np.all(np.isnan(bench.read("gripper_pose")))
    np.testing.assert_array_equal(bench.read("object_motion"), np.eye(4).ravel())
    assert not bench.dut.HasAnyDirectFeedthrough()

    bench.step_to(5)

    assert_no_points(bench)
    np.testing.assert_allclose(
        bench.read("gripper_pose").reshape(4, 4), gripper_pose(joints(4 * PERIOD)), atol=1e-12
    )


@pytest.mark.parametrize("latency", [0, 1, 16, 40])
def test_late_tracks_of_a_held_object_are_propagated_to_now(bench: ArmBench, latency: int) -> None:
    for tick in range(160):
        if tick >= latency and (tick - latency) % 32 == 0:
            stamp = (tick - latency) * PERIOD
            bench.fix(tracked_points=seen(held_points(stamp), stamp))
        bench.step(joints(tick * PERIOD))

        if tick >= latency:
            assert_held(bench, tick)
            assert np.all(bench.read("confidence") == 1.0)


@pytest.mark.parametrize(
    ("image_time", "tick"),
    [(None, 100), (76 * PERIOD, 76), (100 * PERIOD, 100), (np.nan, 100), (9.0, 100)],
)
def test_object_motion_is_the_hands_until_the_current_images(
    bench: ArmBench, image_time: float | None, tick: int
) -> None:
    bench.fix(tracked_points=seen(held_points(0.0), 0.0))
    if image_time is not None:
        bench.fix(image_time=image_time)

    bench.step_to(101)

    # Until now without images, and with stamps in the future.
    expected = gripper_pose(joints(tick * PERIOD)) @ np.linalg.inv(gripper_pose(joints(0.0)))
    np.testing.assert_allclose(
        bench.read("object_motion").reshape(4, 4), expected, rtol=0.0, atol=1e-12
    )
    # The points move with the hand until now, whatever images there are.
    assert_held(bench, 100)


@pytest.mark.parametrize("holding", [0.0, 0.5, np.nan])
def test_without_a_grasp_the_points_stay(bench: ArmBench, holding: float) -> None:
    bench.fix(holding=holding, tracked_points=seen(P_G, 0.0))

    bench.step_to(60)

    np.testing.assert_array_equal(bench.points(), P_G)
    np.testing.assert_array_equal(bench.read("object_motion"), np.eye(4).ravel())


def test_the_object_moves_from_the_grasp_onwards(bench: ArmBench) -> None:
    bench.fix(holding=0.0)
    bench.step_to(30)
    bench.fix(tracked_points=seen(held_points(29 * PERIOD), 29 * PERIOD), holding=1.0)

    bench.step_to(60)

    assert_held(bench, 59)


def test_a_track_that_grows_too_old_loses_its_confidence(two_joint_arm: ArmKinematics) -> None:
    bench = make_bench(two_joint_arm, max_age=0.25)
    bench.fix(tracked_points=seen(held_points(0.0), 0.0))

    bench.step_to(65)  # the update at 64 ticks, 0.25 s
    at_the_limit = bench.read("confidence")
    bench.step_to(66)

    assert np.all(at_the_limit == 1.0)
    assert np.all(bench.read("confidence") == 0.0)
    assert bench.read("age") == 65 * PERIOD
    assert_held(bench, 65)


def test_motion_from_before_the_history_is_unknown(two_joint_arm: ArmKinematics) -> None:
    bench = make_bench(two_joint_arm, max_age=0.25)
    bench.fix(image_time=PERIOD)
    bench.step_to(200)
    bench.fix(tracked_points=seen(P_G, 0.0))

    bench.step(joints(bench.time))

    assert np.all(np.isnan(bench.points()))
    assert np.all(bench.read("confidence") == 0.0)
    assert np.all(np.isnan(bench.read("object_motion")))


def test_without_joint_positions_the_motion_rests_until_they_are_known(bench: ArmBench) -> None:
    bench.fix(tracked_points=seen(held_points(0.0), 0.0))
    bench.step_to(20)
    before = {name: bench.read(name) for name in ("points", "gripper_pose", "object_motion")}

    bench.step_to(30, lambda time: np.array([np.nan, 0.0]))

    for name, value in before.items():
        np.testing.assert_allclose(bench.read(name), value, rtol=0.0, atol=1e-12)
    assert bench.read("age") == 29 * PERIOD
    # The hand has moved in the meantime.
    bench.step_to(40)
    assert_held(bench, 39)


def test_a_point_that_was_not_observed_has_no_confidence(bench: ArmBench) -> None:
    positions, confidence = held_points(0.0), np.array([1.0, 0.0, 0.5, 1.0])
    positions[1] = np.nan
    bench.fix(tracked_points=TrackedPoints(positions, confidence, 0.0))

    bench.step_to(10)

    np.testing.assert_array_equal(bench.read("confidence"), confidence)
    np.testing.assert_array_equal(np.isnan(bench.points()[:, 0]), [False, True, False, False])


def test_a_short_loss_is_bridged(bench: ArmBench) -> None:
    bench.fix(tracked_points=seen(held_points(0.0), 0.0))
    bench.step_to(32)
    bench.fix(tracked_points=TrackedPoints.lost(N, 32 * PERIOD))

    bench.step_to(40)

    assert np.all(bench.read("confidence") == 1.0)
    assert bench.read("age") == 39 * PERIOD
    assert_held(bench, 39)


def test_a_stamp_that_does_not_advance_changes_nothing(bench: ArmBench) -> None:
    bench.fix(tracked_points=seen(held_points(0.0), 0.0))
    bench.step_to(10)
    bench.fix(tracked_points=seen(np.zeros((N, 3)), 0.0))

    bench.step_to(20)

    assert_held(bench, 19)


@pytest.mark.parametrize("wrong", [ABSENT, np.zeros((N, 3)), TrackedPoints.lost(N + 1, 0.0)])
def test_a_track_of_other_points_is_refused(bench: ArmBench, wrong: object) -> None:
    bench.fix(tracked_points=wrong)

    with pytest.raises(InvalidValueError, match="tracked_points"):
        bench.step(joints(0.0))


def turn_about_z(angle: float, x: float = 0.0) -> np.ndarray:
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    X[0, 3] = x
    return X


def filled_history(count: int, duration: float = 0.1) -> np.ndarray:
    history = empty_history(duration, PERIOD)
    for tick in range(count):
        record_motion(history, tick * PERIOD, turn_about_z(0.01 * tick, 0.1 * tick), PERIOD)
    return history


def test_a_history_reaches_back_over_its_duration_and_no_farther() -> None:
    history = filled_history(100, duration=0.1)

    assert motion_at(history, 99 * PERIOD - 0.1, PERIOD) is not None
    assert motion_at(history, 60 * PERIOD, PERIOD) is None


def test_the_future_and_an_empty_history_are_unknown() -> None:
    assert motion_at(filled_history(10), 10 * PERIOD, PERIOD) is None
    assert motion_at(filled_history(10), -PERIOD, PERIOD) is None
    assert motion_at(empty_history(0.1, PERIOD), 0.0, PERIOD) is None


def test_between_samples_of_the_history_the_motion_is_interpolated() -> None:
    history = filled_history(100)

    X = motion_at(history, 95.25 * PERIOD, PERIOD)

    np.testing.assert_allclose(X, turn_about_z(0.9525, 9.525), atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 1e-13, -1e-13])
def test_a_sample_of_the_history_is_returned_exactly(error: float) -> None:
    X = motion_at(filled_history(100), 95 * PERIOD + error, PERIOD)

    np.testing.assert_array_equal(X, turn_about_z(0.01 * 95, 0.1 * 95))
