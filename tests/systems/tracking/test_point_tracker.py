"""When the point tracker captures, and what it reports."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U
from system_bench import SystemBench

from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import ABSENT, Absent
from poil_drake.systems.capture_timing import RecordedTiming, SimulatedDelay
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.point_tracker import PointTracker

PERIOD = 1 / 8
AFTER = 1 / 1024  # Long enough after an event to see its effect.
W, H, N = 4, 3, 3
CAMERA = CameraModel("left", W, H, np.diag([5.0, 5.0, 1.0]), np.eye(4))
QUERY = np.array([[0.5, 0.0, 0.1], [0.6, 0.0, 0.1], [0.5, 0.1, 0.2]])
MASK = (np.ones((H, W), dtype=bool),)
MASKS = PartMasks(object_masks=MASK, part_masks=MASK)


class Scene(LeafSystem):
    """A camera whose depth is 1 m + the time, and forward kinematics along x with the time."""

    def __init__(self, *, frozen_from: float = np.inf, moving: float = 1.0):
        super().__init__()
        self._frozen_from, self._moving = frozen_from, moving
        self.captures: list[float] = []
        time = {self.time_ticket()}
        self.DeclareAbstractOutputPort(
            "rgb", lambda: Value(ImageRgba8U(W, H)), lambda context, output: None, time
        )
        self.DeclareAbstractOutputPort(
            "depth", lambda: Value(ImageDepth32F(W, H)), self._depth, time
        )
        self.DeclareVectorOutputPort("stamp", 1, self._stamp, time)
        self.DeclareVectorOutputPort("object_motion", 16, self._motion, time)

    def _depth(self, context: Context, output: AbstractValue) -> None:
        self.captures.append(context.get_time())
        output.get_mutable_value().mutable_data[:] = 1.0 + context.get_time()

    def _stamp(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, min(context.get_time(), self._frozen_from))

    def _motion(self, context: Context, output: BasicVector) -> None:
        X_M = np.eye(4)
        X_M[0, 3] = self._moving * context.get_time()
        output.SetFromVector(X_M.ravel())


class SummingTracker:
    """Its points depend on every frame and prior so far, so that a missing one shows."""

    def start(
        self, frame: MultiViewFrame, query_points: np.ndarray, object_masks: tuple[np.ndarray, ...]
    ) -> TrackerOutput:
        return self._output(query_points, frame)

    def step(
        self, state: np.ndarray, frame: MultiViewFrame, motion_prior: np.ndarray | None = None
    ) -> TrackerOutput:
        forward = 0.0 if motion_prior is None else motion_prior[0, 3]
        return self._output(np.sin(state) + frame.images[0].depth[0, 0] + forward, frame)

    def _output(self, points: np.ndarray, frame: MultiViewFrame) -> TrackerOutput:
        return TrackerOutput(points, TrackedPoints(points, np.ones(N), frame.stamp), False)


class TrackerBench(SystemBench):
    """Scene and tracker in a diagram."""

    def __init__(
        self,
        *,
        tracker: object | None = None,
        scene: Scene | None = None,
        with_stamps: bool = False,
        query_points: np.ndarray | None = QUERY,
        masks: PartMasks | Absent = MASKS,
        **options: Any,
    ):
        builder = DiagramBuilder()
        self.scene = builder.AddSystem(scene or Scene())
        dut = PointTracker(
            tracker=tracker or SummingTracker(),
            cameras=[CAMERA],
            num_points=N,
            query_points=query_points,
            **options,
        )
        builder.AddSystem(dut)
        wires = {"rgb": "left.rgb_image", "depth": "left.depth_image"}
        wires |= {"object_motion": "object_motion"}
        wires |= {"stamp": "left.image_time"} if with_stamps else {}
        for output, name in wires.items():
            builder.Connect(self.scene.GetOutputPort(output), dut.GetInputPort(name))
        super().__init__(dut, builder.Build(), masks=masks)

    @property
    def points(self) -> TrackedPoints:
        return self.read("tracked_points")


MakeBench = Callable[..., TrackerBench]


@pytest.fixture
def make_bench() -> Iterator[MakeBench]:
    """Makes benches; their workers end with the test."""
    benches: list[TrackerBench] = []

    def make(**arguments) -> TrackerBench:
        benches.append(TrackerBench(**arguments))
        return benches[-1]

    yield make
    for bench in benches:
        bench.dut.close()


def test_points_are_those_of_the_tracker_fed_by_hand(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=1 / 16))

    bench.advance_to(2 * PERIOD + 1 / 16 + AFTER)

    # Depth is 1 + t, and each prior is 1/8 m along x.
    first = np.sin(QUERY) + np.float32(1 + PERIOD) + PERIOD
    second = np.sin(first) + np.float32(1 + 2 * PERIOD) + PERIOD
    np.testing.assert_allclose(bench.points.positions, second, atol=1e-12)


def test_the_frame_is_that_of_the_last_capture(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=1 / 16))

    bench.advance_to(PERIOD + AFTER)

    assert bench.read("frame") is not None
    assert bench.read("frame").stamp == PERIOD
    assert bench.read("frame").images[0].depth[0, 0] == np.float32(1 + PERIOD)
    assert bench.points.stamp == 0.0


def test_a_nan_motion_is_no_prior(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=0.0), scene=Scene(moving=np.nan))

    bench.advance_to(PERIOD + AFTER)

    expected = np.sin(QUERY) + np.float32(1 + PERIOD)
    np.testing.assert_allclose(bench.points.positions, expected, atol=1e-12)


def test_it_waits_for_masks_and_query_points(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=0.0), query_points=None)
    inputs = [(ABSENT, QUERY), (MASKS, np.full(QUERY.shape, np.nan)), (MASKS, QUERY)]
    statuses = []

    for tick, (masks, query_points) in enumerate(inputs):
        bench.fix(masks=masks, query_points=query_points)
        bench.advance_to(tick * PERIOD + AFTER)
        statuses.append(bench.read("status")[0])

    waiting, tracking = TrackerStatus.WAITING, TrackerStatus.TRACKING
    assert statuses == [waiting, waiting, tracking]
    np.testing.assert_array_equal(bench.points.positions, QUERY)


def test_a_trackers_own_error_ends_the_simulation(make_bench: MakeBench) -> None:
    tracker = SummingTracker()
    tracker.step = lambda state, frame, prior: 1 / 0
    bench = make_bench(tracker=tracker)

    with pytest.raises(ZeroDivisionError):
        bench.advance_to(1.0)


def test_two_contexts_of_one_tracker_do_not_mix(make_bench: MakeBench) -> None:
    bench = make_bench(timing=SimulatedDelay(latency=1 / 16))
    bench.advance_to(0.5)
    first = bench.points.positions
    context = bench.simulator.get_mutable_context()
    context.SetTime(0.0)
    bench.simulator.get_system().SetDefaultContext(context)
    bench.simulator.Initialize()
    assert bench.read("status") == TrackerStatus.WAITING

    bench.advance_to(0.5)

    np.testing.assert_array_equal(bench.points.positions, first)


def test_before_the_first_event_nothing_is_tracked(make_bench: MakeBench) -> None:
    bench = make_bench()

    assert bench.read("status") == TrackerStatus.WAITING
    assert bench.points.stamp == -np.inf
    np.testing.assert_array_equal(bench.points.confidence, 0.0)
    assert bench.read("frame") is ABSENT


def test_a_frozen_camera_is_not_tracked(make_bench: MakeBench) -> None:
    bench = make_bench(
        timing=SimulatedDelay(latency=0.0), scene=Scene(frozen_from=0.25), with_stamps=True
    )

    bench.advance_to(1.0)

    assert bench.points.stamp == 0.25


def test_a_stopwatch_counts_the_work(make_bench: MakeBench) -> None:
    stopwatch = Stopwatch()
    bench = make_bench(timing=SimulatedDelay(latency=0.0), stopwatch=stopwatch)

    bench.advance_to(0.3)

    assert stopwatch.durations("tracking").shape == (3,)


def test_a_least_interval_between_tracked_images_is_kept(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(period=1 / 64, latency=0.0)
    bench = make_bench(timing=timing, min_interval=0.1, with_stamps=True)

    bench.advance_to(0.5)

    # Each time the first image that is at least 0.1 s newer than the last tracked one.
    assert bench.scene.captures == [0.0, 7 / 64, 14 / 64, 21 / 64, 28 / 64]


def test_tracking_once_stops_when_the_points_are_found(make_bench: MakeBench) -> None:
    timing = SimulatedDelay(latency=0.0)
    bench = make_bench(timing=timing, once=True, masks=ABSENT, with_stamps=True)
    bench.advance_to(2 * PERIOD + AFTER)
    assert bench.read("status") == TrackerStatus.WAITING
    bench.fix(masks=MASKS)

    bench.advance_to(8 * PERIOD)

    assert bench.read("status") == TrackerStatus.TRACKING
    assert bench.points.stamp == 3 * PERIOD
    assert bench.scene.captures == [0.0, PERIOD, 2 * PERIOD, 3 * PERIOD]


def test_a_replay_skips_what_its_log_lacks(make_bench: MakeBench) -> None:
    timing = RecordedTiming(
        captured=(0.125, 0.25), released=((0.1875, 0.125), (0.3125, 0.25)), period=1 / 64
    )
    bench = make_bench(timing=timing, scene=Scene(frozen_from=0.125), with_stamps=True)

    bench.advance_to(0.5)

    # The image of the second capture is missing, so that its track is that of the first.
    assert bench.scene.captures == [0.125]
    assert bench.points.stamp == 0.125
