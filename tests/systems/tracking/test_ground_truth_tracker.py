import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from system_bench import SystemBench

from poil_drake.errors import InvalidValueError
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.ground_truth_tracker import (
    GroundTruthTracker,
    GroundTruthTrackerConfig,
    observe,
)

PERIOD = 1 / 8
AFTER = 1 / 1024
QUERY = np.array([[0.5, 0.0, 0.1], [0.6, 0.0, 0.1], [0.5, 0.1, 0.2]])
N = len(QUERY)


def pose(time: float) -> RigidTransform:
    return RigidTransform(RotationMatrix.MakeZRotation(0.5 + time), [0.4, 0.1 * time, 0.2])


def where(time: float) -> np.ndarray:
    """The points fixed to the body at time 0, later, by homogeneous coordinates."""
    motion = pose(time).GetAsMatrix4() @ np.linalg.inv(pose(0.0).GetAsMatrix4())
    return (motion @ np.c_[QUERY, np.ones(N)].T).T[:, :3]


class Poses(LeafSystem):
    """The world and one moving body."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareAbstractOutputPort(
            "body_poses",
            lambda: AbstractValue.Make([RigidTransform()]),
            self._calc,
            {self.time_ticket()},
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        output.set_value([RigidTransform(), pose(context.get_time())])


def make_bench(
    config: GroundTruthTrackerConfig | None = None, query_points: np.ndarray | None = QUERY
) -> SystemBench:
    """The dut, which watches the moving body."""
    builder = DiagramBuilder()
    poses = builder.AddSystem(Poses())
    dut = builder.AddSystem(
        GroundTruthTracker(
            body_index=BodyIndex(1), num_points=N, query_points=query_points, config=config
        )
    )
    builder.Connect(poses.GetOutputPort("body_poses"), dut.GetInputPort("body_poses"))
    return SystemBench(dut, builder.Build())


def test_before_the_first_release_nothing_is_known() -> None:
    bench = make_bench()

    bench.advance_to(1 / 16)

    assert bench.read("status") == TrackerStatus.WAITING
    assert bench.read("tracked_points").stamp == -np.inf
    np.testing.assert_array_equal(bench.read("tracked_points").confidence, np.zeros(N))


@pytest.mark.parametrize("latency", [0.0, 1 / 16, 1 / 8, 0.3])
def test_it_reports_the_truth_at_capture_a_latency_later(latency: float) -> None:
    bench = make_bench(GroundTruthTrackerConfig(latency=latency))

    for tick in range(5):
        bench.advance_to(tick * PERIOD + latency + AFTER)

        points = bench.read("tracked_points")
        assert bench.read("status") == TrackerStatus.TRACKING
        assert points.stamp == tick * PERIOD
        np.testing.assert_allclose(points.positions, where(tick * PERIOD), atol=1e-12)


def test_it_waits_for_the_query_points() -> None:
    bench = make_bench(GroundTruthTrackerConfig(latency=0.0), query_points=None)
    bench.fix(query_points=np.full(3 * N, np.nan))
    bench.advance_to(PERIOD + AFTER)
    assert bench.read("status") == TrackerStatus.WAITING
    bench.fix(query_points=where(2 * PERIOD))

    bench.advance_to(4 * PERIOD + AFTER)

    points = bench.read("tracked_points")
    np.testing.assert_allclose(points.positions, where(4 * PERIOD), atol=1e-12)


def test_a_lost_frame_is_reported_as_lost() -> None:
    bench = make_bench(GroundTruthTrackerConfig(latency=0.0, frame_dropout=1.0))

    bench.advance_to(AFTER)

    assert bench.read("status") == TrackerStatus.LOST
    assert bench.read("tracked_points").stamp == 0.0
    np.testing.assert_array_equal(bench.read("tracked_points").confidence, np.zeros(N))


def test_the_noise_has_the_requested_size_and_is_repeatable() -> None:
    config = GroundTruthTrackerConfig(noise=0.002, seed=3)
    points = np.zeros((2000, 3))

    first, again, later = (observe(points, 0.0, tick, config) for tick in (5, 5, 6))

    np.testing.assert_array_equal(first.positions, again.positions)
    assert not np.array_equal(first.positions, later.positions)
    # The standard deviation of 6000 numbers is known to 1 %; 5 sigma of that.
    assert np.std(first.positions) == pytest.approx(0.002, rel=0.05)


def test_points_drop_out_as_often_as_requested() -> None:
    config = GroundTruthTrackerConfig(point_dropout=0.3)

    seen = observe(np.zeros((5000, 3)), 0.0, 0, config)

    # Binomial: sigma = sqrt(0.3 * 0.7 / 5000) = 0.0065.
    assert np.mean(seen.confidence == 0.0) == pytest.approx(0.3, abs=0.03)
    np.testing.assert_array_equal(np.isnan(seen.positions[:, 0]), seen.confidence == 0.0)


def test_frames_drop_out_as_often_as_requested() -> None:
    config = GroundTruthTrackerConfig(frame_dropout=0.25)

    frames = [observe(QUERY, 0.0, tick, config).confidence for tick in range(800)]

    assert all(frame.all() or not frame.any() for frame in frames)
    # sigma = sqrt(0.25 * 0.75 / 800) = 0.015.
    assert np.mean([not frame.any() for frame in frames]) == pytest.approx(0.25, abs=0.07)


def test_nothing_feeds_through() -> None:
    assert not make_bench().dut.HasAnyDirectFeedthrough()


@pytest.mark.parametrize("wrong", [{"noise": -1.0}, {"point_dropout": 1.1}, {"frame_dropout": -1}])
def test_impossible_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidValueError, match="noise"):
        GroundTruthTrackerConfig(**wrong)
