import numpy as np
import pytest
from system_bench import SystemBench

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.control.point_set_bcsdm import (
    PointSetBcsdm,
    PointSetBcsdmConfig,
    gripper_velocity,
)
from poil_drake.systems.statuses import ControllerStatus

PERIOD = 1 / 256
N = 5
CENTRE = np.array([0.5, 0.0, 0.2])
OFFSETS = np.array([[0.03, 0, 0], [-0.03, 0, 0.01], [0, 0.04, 0], [0, -0.04, 0.01], [0, 0, 0.05]])
SHAPE = CENTRE + OFFSETS
DT = 0.05
STEP = np.array([0.0, 0.01, 0.002])
INPUTS = ("points", "confidence", "gripper_pose")
OUTPUTS = ("spatial_velocity", "tau", "potential", "mean_error", "status", "target_points")
WINDOWED = PointSetBcsdmConfig(
    bcsdm=BcsdmConfig(interpolate=False, progress_window=(0.1, 0.1), window_escape_ratio=0.0)
)


@pytest.fixture
def reference() -> PointTrajectory:
    """The shape slides by `STEP` every 50 ms for 1 s."""
    positions = SHAPE + np.arange(21)[:, None, None] * STEP
    velocities = np.broadcast_to(STEP / DT, positions.shape).copy()
    velocities[-1] = 0.0
    return PointTrajectory(DT * np.arange(21), positions, velocities)


def pose_at(p_WG: np.ndarray) -> np.ndarray:
    X_WG = np.eye(4)
    X_WG[:3, 3] = p_WG
    return X_WG


def make_bench(
    reference: PointTrajectory,
    points: np.ndarray,
    config: PointSetBcsdmConfig | None = None,
    **inputs: np.ndarray,
) -> SystemBench:
    dut = PointSetBcsdm(reference=reference, period=PERIOD, config=config)
    inputs = {"confidence": np.ones(N), "gripper_pose": pose_at(SHAPE[0])} | inputs
    return SystemBench(dut, points=points, **inputs)


def test_on_the_reference_it_moves_as_the_reference(reference: PointTrajectory) -> None:
    bench = make_bench(reference, reference.positions[7])

    np.testing.assert_allclose(bench.read("spatial_velocity"), [0, 0, 0, *STEP / DT], atol=1e-12)
    assert bench.read("tau") == pytest.approx(7 * DT)
    assert bench.read("mean_error") == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(
        bench.read("target_points"), reference.positions[7].ravel(), atol=1e-12
    )
    assert bench.read("status") == ControllerStatus.OK


def test_outputs_are_those_of_the_pure_functions(reference: PointTrajectory) -> None:
    rng = np.random.default_rng(0)
    points = reference.positions[7] + 0.004 * rng.normal(size=(N, 3))
    confidence = rng.uniform(0.5, 1.0, N)
    X_WG = pose_at(SHAPE[0] + [0.0, 0.0, 0.1])
    field = point_set_bcsdm(points, reference, BcsdmConfig(), confidence)

    bench = make_bench(reference, points, confidence=confidence, gripper_pose=X_WG)

    answer = gripper_velocity(points, confidence, X_WG, reference, PointSetBcsdmConfig())
    np.testing.assert_array_equal(bench.read("spatial_velocity"), answer.V_WG)
    assert bench.read("tau") == field.tau
    assert bench.read("potential") == field.potential
    assert bench.read("mean_error") == field.mean_error


def test_the_gripper_moves_rigidly_with_the_points(reference: PointTrajectory) -> None:
    # The points are turned by 0.2 rad about z; the field turns them back about their centroid.
    angle = 0.2
    R = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]]
    )
    centroid = reference.positions[-1].mean(axis=0)
    points = (reference.positions[-1] - centroid) @ R.T + centroid
    p_WG = centroid + np.array([0.0, 0.2, 0.0])

    bench = make_bench(reference, points, gripper_pose=pose_at(p_WG))

    V = bench.read("spatial_velocity")
    assert V[2] < -0.1
    # The gripper's origin moves by ω x r, r = 0.2 m along y from a centroid at rest.
    np.testing.assert_allclose(V[3:], [-0.2 * V[2], 0.0, 0.2 * V[0]], atol=1e-9)


@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_fast_twists_are_scaled_with_their_direction_kept(
    reference: PointTrajectory, offset: float
) -> None:
    points = reference.positions[-1] + [0.0, 0.3, 0.0]
    slow = PointSetBcsdmConfig(max_linear_speed=0.1, max_angular_speed=0.2)
    fast = PointSetBcsdmConfig(max_linear_speed=100.0, max_angular_speed=100.0)
    X_WG = pose_at(SHAPE[0] + [offset, 0.0, 0.0])

    limited = make_bench(reference, points, gripper_pose=X_WG, config=slow)
    free = make_bench(reference, points, gripper_pose=X_WG, config=fast)

    V, V_free = limited.read("spatial_velocity"), free.read("spatial_velocity")
    assert np.linalg.norm(V[3:]) == pytest.approx(0.1)
    np.testing.assert_allclose(V * np.linalg.norm(V_free), V_free * np.linalg.norm(V), atol=1e-12)
    assert limited.read("status") == ControllerStatus.LIMITED
    assert free.read("status") == ControllerStatus.OK


def test_a_turn_does_not_swing_a_far_gripper_too_fast(reference: PointTrajectory) -> None:
    centroid = reference.positions[-1].mean(axis=0)
    points = (reference.positions[-1] - centroid) @ np.diag([-1.0, 1.0, -1.0]) + centroid
    points = points + 1e-3 * np.random.default_rng(0).normal(size=points.shape)

    bench = make_bench(
        reference, points, gripper_pose=pose_at(centroid + np.array([1.0, 0.5, 0.0]))
    )

    V = bench.read("spatial_velocity")
    assert np.linalg.norm(V[:3]) <= 1.5 + 1e-12
    assert np.linalg.norm(V[3:]) <= 0.3 + 1e-12


def test_at_the_end_it_reports_the_goal(reference: PointTrajectory) -> None:
    bench = make_bench(reference, reference.positions[-1] + [0.0, 0.0, 0.0005])

    assert bench.read("status") == ControllerStatus.GOAL
    assert np.linalg.norm(bench.read("spatial_velocity")) < 0.002


def assert_lost(bench: SystemBench) -> None:
    assert bench.read("status") == ControllerStatus.LOST
    np.testing.assert_array_equal(bench.read("spatial_velocity"), np.zeros(6))
    for name in ("tau", "potential", "mean_error", "target_points"):
        assert np.all(np.isnan(bench.read(name)))


@pytest.mark.parametrize(
    ("known", "confidence"),
    [(0, 0.0), (N, 0.0), (2, 1.0)],
    ids=["before the first points", "stale points", "two points"],
)
def test_it_rests_without_enough_points(
    reference: PointTrajectory, known: int, confidence: float
) -> None:
    points = reference.positions[7].copy()
    points[known:] = np.nan

    assert_lost(make_bench(reference, points, confidence=np.full(N, confidence)))


def test_points_outside_the_workspace_are_left_out(reference: PointTrajectory) -> None:
    points = reference.positions[7].copy()
    points[0] = [0.5, 0.0, -0.2]  # below the table
    points[1] = [0.5, 2.0, 0.2]  # beyond the reach
    confidence = np.array([0.0, 0.0, 1.0, 1.0, 1.0])

    all_given = make_bench(reference, points)
    left_out = make_bench(reference, reference.positions[7], confidence=confidence)

    np.testing.assert_array_equal(
        all_given.read("spatial_velocity"), left_out.read("spatial_velocity")
    )
    assert all_given.read("status") == ControllerStatus.OK
    points[2] = [-3.0, 0.0, 0.2]
    assert_lost(make_bench(reference, points))


def test_without_a_gripper_pose_it_stands_still(reference: PointTrajectory) -> None:
    bench = make_bench(reference, reference.positions[7], gripper_pose=np.full((4, 4), np.nan))

    np.testing.assert_array_equal(bench.read("spatial_velocity"), np.zeros(6))
    assert bench.read("status") == ControllerStatus.INVALID_INPUT
    assert bench.read("tau") == pytest.approx(7 * DT)


def test_every_output_follows_every_input(reference: PointTrajectory) -> None:
    dut = PointSetBcsdm(reference=reference)

    for output in OUTPUTS:
        for name in INPUTS:
            through = dut.HasDirectFeedthrough(
                dut.GetInputPort(name).get_index(), dut.GetOutputPort(output).get_index()
            )
            assert through, f"{name} -> {output}"


@pytest.mark.parametrize("lost_periods", [0, 2])
def test_with_a_progress_window_it_remembers_tau_through_a_loss(
    reference: PointTrajectory, lost_periods: int
) -> None:
    bench = make_bench(reference, reference.positions[4], WINDOWED)
    bench.advance_to(PERIOD)
    bench.fix(confidence=np.zeros(N))
    bench.advance(lost_periods * PERIOD)
    bench.fix(confidence=np.ones(N))

    bench.fix(points=reference.positions[16])

    # 4 samples of 50 ms, and no farther than 0.1 s from there.
    assert bench.read("tau") == pytest.approx(4 * DT + 0.1)


def shifted(reference: PointTrajectory, by: np.ndarray) -> PointTrajectory:
    return PointTrajectory(reference.times, reference.positions + by, reference.velocities)


def test_a_reference_at_the_port_takes_the_place_of_the_constructors(
    reference: PointTrajectory,
) -> None:
    by = np.array([0.0, 0.0, 0.1])
    bench = make_bench(reference, reference.positions[7] + by)

    bench.fix(reference=shifted(reference, by))

    np.testing.assert_allclose(bench.read("spatial_velocity"), [0, 0, 0, *STEP / DT], atol=1e-12)
    assert bench.read("mean_error") == pytest.approx(0.0, abs=1e-12)


def test_it_stands_still_while_there_is_nothing_to_follow(reference: PointTrajectory) -> None:
    bench = make_bench(reference, reference.positions[7])

    bench.fix(reference=ABSENT)

    np.testing.assert_array_equal(bench.read("spatial_velocity"), np.zeros(6))
    assert bench.read("status") == ControllerStatus.HOLDING
    bench.fix(points=np.full(3 * N, np.nan))
    assert bench.read("status") == ControllerStatus.LOST


def test_it_finds_its_place_again_after_a_stop(reference: PointTrajectory) -> None:
    bench = make_bench(reference, reference.positions[4], WINDOWED)
    plan = shifted(reference, np.zeros(3))
    bench.fix(reference=plan)
    bench.advance_to(PERIOD)

    bench.fix(reference=ABSENT)
    bench.advance_to(2 * PERIOD)
    bench.fix(reference=plan)

    # Elsewhere on the plan by now, as where it comes near itself: the window holds it.
    bench.fix(points=reference.positions[16])
    assert bench.read("tau") == pytest.approx(4 * DT + 0.1)


def test_the_memory_does_not_outlive_its_reference(reference: PointTrajectory) -> None:
    bench = make_bench(reference, reference.positions[4], WINDOWED)
    bench.advance_to(PERIOD)
    bench.fix(points=reference.positions[16])
    assert bench.read("tau") == pytest.approx(4 * DT + 0.1)

    bench.fix(reference=shifted(reference, np.zeros(3)))

    assert bench.read("tau") == pytest.approx(16 * DT)
