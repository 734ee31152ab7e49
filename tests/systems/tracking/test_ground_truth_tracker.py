import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from system_bench import SystemBench

from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.ground_truth_tracker import (
    GroundTruthTracker,
    GroundTruthTrackerConfig,
)

PERIOD = 1 / 8
AFTER = 1 / 1024
QUERY = np.array([[0.5, 0.0, 0.1], [0.6, 0.0, 0.1], [0.5, 0.1, 0.2]])
N = len(QUERY)


def pose(time: float) -> RigidTransform:
    return RigidTransform(RotationMatrix.MakeZRotation(0.5 + time), [0.4, 0.1 * time, 0.2])


def points_at(time: float) -> np.ndarray:
    """Returns the points fixed to the body (N, 3), by homogeneous coordinates."""
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


def make_bench(config: GroundTruthTrackerConfig | None = None) -> SystemBench:
    """The dut, which watches the moving body."""
    builder = DiagramBuilder()
    poses = builder.AddSystem(Poses())
    dut = builder.AddSystem(
        GroundTruthTracker(body_index=BodyIndex(1), query_points=QUERY, config=config)
    )
    builder.Connect(poses.GetOutputPort("body_poses"), dut.GetInputPort("body_poses"))
    return SystemBench(dut, builder.Build())


def test_before_the_first_release_nothing_is_known() -> None:
    bench = make_bench()
    assert not bench.dut.HasAnyDirectFeedthrough()

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
        np.testing.assert_allclose(points.positions, points_at(tick * PERIOD), atol=1e-12)
