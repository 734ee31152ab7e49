import threading
from collections.abc import Callable

import numpy as np
import pytest
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from poil_drake.errors import InvalidValueError
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.systems.point_tracker import PointTracker, PointTrackerConfig
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.stopwatch import Stopwatch

PERIOD = 1 / 8
AFTER = 1 / 1024  # long enough after an event to see what it did
W, H, N = 4, 3, 3
CAMERA = CameraModel(
    name="left",
    width=W,
    height=H,
    K=np.array([[5.0, 0.0, 1.5], [0.0, 5.0, 1.0], [0.0, 0.0, 1.0]]),
    X_WC=np.eye(4),
)
QUERY = np.array([[0.5, 0.0, 0.1], [0.6, 0.0, 0.1], [0.5, 0.1, 0.2]])
MASK = (np.ones((H, W), dtype=bool),)
MASKS = PartMasks(object_masks=MASK, part_masks=MASK)


class Scene(LeafSystem):
    """A camera whose depth is 1 m + the time, and forward kinematics along x with the time."""

    def __init__(self, frozen_from: float = np.inf):
        super().__init__()
        self._frozen_from = frozen_from
        self.looks: list[float] = []
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
        self.looks.append(context.get_time())
        output.get_mutable_value().mutable_data[:] = 1.0 + context.get_time()

    def _stamp(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, min(context.get_time(), self._frozen_from))

    def _motion(self, context: Context, output: BasicVector) -> None:
        X_M = np.eye(4)
        X_M[0, 3] = context.get_time()
        output.SetFromVector(X_M.ravel())


class SummingTracker:
    """Its points depend on every frame and prior so far, so that nothing can go missing."""

    lost_at: frozenset[float] = frozenset()

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
        if frame.stamp in self.lost_at:
            return TrackerOutput(points, TrackedPoints.lost(N, frame.stamp), True)
        return TrackerOutput(points, TrackedPoints(points, np.ones(N), frame.stamp), False)


class Bench:
    """Scene and tracker in a diagram."""

    def __init__(
        self,
        *,
        config: PointTrackerConfig,
        tracker: object | None = None,
        scene: Scene | None = None,
        with_stamps: bool = False,
        query_points: np.ndarray | None = QUERY,
        masks: PartMasks | None = MASKS,
        stopwatch: Stopwatch | None = None,
    ):
        builder = DiagramBuilder()
        self.scene = builder.AddSystem(scene or Scene())
        self.dut = builder.AddSystem(
            PointTracker(
                tracker=tracker or SummingTracker(),
                cameras=[CAMERA],
                num_points=N,
                query_points=query_points,
                config=config,
                stopwatch=stopwatch,
            )
        )
        wires = {"rgb": "left.rgb_image", "depth": "left.depth_image"}
        wires |= {"object_motion": "object_motion"}
        wires |= {"stamp": "left.image_time"} if with_stamps else {}
        for output, name in wires.items():
            builder.Connect(self.scene.GetOutputPort(output), self.dut.GetInputPort(name))
        self.simulator = Simulator(builder.Build())
        self.context = self.dut.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.fix_masks(masks)

    def fix_masks(self, masks: PartMasks | None) -> None:
        self.dut.GetInputPort("masks").FixValue(self.context, Value(masks))

    def advance_to(self, time: float) -> None:
        self.simulator.AdvanceTo(time)

    @property
    def points(self) -> TrackedPoints:
        return self.dut.GetOutputPort("tracked_points").Eval(self.context)

    @property
    def status(self) -> TrackerStatus:
        return TrackerStatus(int(self.dut.GetOutputPort("status").Eval(self.context)[0]))

    @property
    def frame(self) -> MultiViewFrame | None:
        return self.dut.GetOutputPort("frame").Eval(self.context)


@pytest.fixture
def make_bench():
    benches: list[Bench] = []

    def make(**arguments) -> Bench:
        benches.append(Bench(**arguments))
        return benches[-1]

    yield make
    for bench in benches:
        bench.dut.close()


def test_before_the_first_event_nothing_is_tracked(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(config=PointTrackerConfig())

    assert bench.status is TrackerStatus.WAITING
    assert bench.points.stamp == -np.inf
    np.testing.assert_array_equal(bench.points.confidence, np.zeros(N))
    assert bench.frame is None


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("latency", [1 / 64, 1 / 16, 1 / 8, 3 / 16, 1 / 4, 0.3])
def test_each_capture_is_released_exactly_its_latency_later(
    make_bench: Callable[..., Bench], latency: float, parallel: bool
) -> None:
    config = PointTrackerConfig(period=PERIOD, latency=latency, parallel=parallel)
    bench = make_bench(config=config)
    previous = -np.inf

    for tick in range(4):
        stamp = tick * PERIOD
        # Time's end is before the updates of that instant.
        bench.advance_to(stamp + latency)
        assert bench.points.stamp == previous
        bench.advance_to(stamp + latency + AFTER)
        assert bench.points.stamp == stamp
        assert bench.status is TrackerStatus.TRACKING
        previous = stamp


def test_without_latency_a_capture_is_released_at_once(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(config=PointTrackerConfig(latency=0.0))

    bench.advance_to(AFTER)

    assert bench.points.stamp == 0.0
    np.testing.assert_array_equal(bench.points.positions, QUERY)


@pytest.mark.parametrize("latency", [0.0, 1 / 16, 1 / 8, 0.3])
def test_the_outcome_is_the_same_with_and_without_a_worker(
    make_bench: Callable[..., Bench], latency: float
) -> None:
    alone, beside = (
        make_bench(config=PointTrackerConfig(latency=latency, parallel=parallel))
        for parallel in (False, True)
    )

    for time in np.arange(AFTER, 2.0, 1 / 32):
        alone.advance_to(time)
        beside.advance_to(time)

        assert alone.points.stamp == beside.points.stamp
        np.testing.assert_array_equal(alone.points.positions, beside.points.positions)


def test_points_are_those_of_the_tracker_fed_by_hand(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(config=PointTrackerConfig(latency=1 / 16))

    bench.advance_to(2 * PERIOD + 1 / 16 + AFTER)

    # Depth is 1 + t, and each prior says 1/8 m along x.
    first = np.sin(QUERY) + np.float32(1 + PERIOD) + PERIOD
    second = np.sin(first) + np.float32(1 + 2 * PERIOD) + PERIOD
    np.testing.assert_allclose(bench.points.positions, second, atol=1e-12)


def test_images_are_looked_at_once_per_capture(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(config=PointTrackerConfig(latency=1 / 16))

    for time in np.arange(AFTER, 0.5, 1 / 64):
        bench.advance_to(time)

    assert bench.scene.looks == [0.0, 0.125, 0.25, 0.375]


def test_the_frame_is_that_of_the_last_capture(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(config=PointTrackerConfig(latency=1 / 16))

    bench.advance_to(PERIOD + AFTER)

    assert bench.frame is not None
    assert bench.frame.stamp == PERIOD
    assert bench.frame.images[0].depth[0, 0] == np.float32(1 + PERIOD)
    assert bench.points.stamp == 0.0


def test_it_waits_for_the_detector(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(config=PointTrackerConfig(latency=0.0), masks=None)
    bench.advance_to(PERIOD + AFTER)
    assert bench.status is TrackerStatus.WAITING
    assert np.all(bench.points.confidence == 0.0)
    bench.fix_masks(MASKS)

    bench.advance_to(2 * PERIOD + AFTER)

    assert bench.status is TrackerStatus.TRACKING
    np.testing.assert_array_equal(bench.points.positions, QUERY)


def test_query_points_may_come_through_the_port(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(config=PointTrackerConfig(latency=0.0), query_points=None)
    port = bench.dut.GetInputPort("query_points")
    port.FixValue(bench.context, np.full(3 * N, np.nan))
    bench.advance_to(AFTER)
    assert bench.status is TrackerStatus.WAITING
    port.FixValue(bench.context, QUERY.ravel())

    bench.advance_to(PERIOD + AFTER)

    np.testing.assert_array_equal(bench.points.positions, QUERY)


def test_a_loss_passes_through(make_bench: Callable[..., Bench]) -> None:
    tracker = SummingTracker()
    tracker.lost_at = frozenset({PERIOD})
    bench = make_bench(config=PointTrackerConfig(latency=1 / 16), tracker=tracker)

    bench.advance_to(PERIOD + 1 / 16 + AFTER)
    status, points = bench.status, bench.points
    bench.advance_to(2 * PERIOD + 1 / 16 + AFTER)

    assert status is TrackerStatus.LOST
    assert points.stamp == PERIOD
    np.testing.assert_array_equal(points.confidence, np.zeros(N))
    assert bench.status is TrackerStatus.TRACKING


def test_a_frozen_camera_is_not_tracked(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(
        config=PointTrackerConfig(latency=0.0), scene=Scene(frozen_from=0.25), with_stamps=True
    )

    bench.advance_to(1.0)

    assert bench.points.stamp == 0.25


@pytest.mark.parametrize("parallel", [False, True])
def test_a_trackers_own_error_ends_the_simulation(
    make_bench: Callable[..., Bench], parallel: bool
) -> None:
    tracker = SummingTracker()
    tracker.step = lambda state, frame, prior: 1 / 0
    bench = make_bench(config=PointTrackerConfig(parallel=parallel), tracker=tracker)

    with pytest.raises(ZeroDivisionError):
        bench.advance_to(1.0)


def test_nothing_feeds_through(make_bench: Callable[..., Bench]) -> None:
    assert not make_bench(config=PointTrackerConfig()).dut.HasAnyDirectFeedthrough()


def test_a_stopwatch_counts_the_work(make_bench: Callable[..., Bench]) -> None:
    stopwatch = Stopwatch()
    bench = make_bench(config=PointTrackerConfig(latency=0.0), stopwatch=stopwatch)

    bench.advance_to(0.3)

    assert stopwatch.durations("tracking").shape == (3,)


def test_two_contexts_of_one_tracker_do_not_mix(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(config=PointTrackerConfig(latency=1 / 16))
    bench.advance_to(0.5)
    first = bench.points.positions
    context = bench.simulator.get_mutable_context()
    context.SetTime(0.0)
    bench.simulator.get_system().SetDefaultContext(context)
    bench.simulator.Initialize()
    assert bench.status is TrackerStatus.WAITING

    bench.advance_to(0.5)

    np.testing.assert_array_equal(bench.points.positions, first)


class PausedTracker(SummingTracker):
    """Goes on only when told."""

    def __init__(self) -> None:
        self.go = threading.Event()

    def start(self, *arguments) -> TrackerOutput:
        self.go.wait()
        return super().start(*arguments)


def test_on_hardware_a_late_result_is_late_and_blocks_nothing() -> None:
    tracker = PausedTracker()
    config = PointTrackerConfig(latency=1 / 64, blocking=False, poll_period=1 / 256)
    bench = Bench(config=config, tracker=tracker)

    bench.advance_to(0.5 + AFTER)  # would never come back if it waited for the tracker
    status = bench.status
    tracker.go.set()
    bench.dut.close()  # the work in hand is finished first
    bench.advance_to(0.5 + 1 / 256 + AFTER)

    assert status is TrackerStatus.WAITING
    assert bench.scene.looks == [0.0]  # frames that come while it is busy are skipped
    assert bench.status is TrackerStatus.TRACKING
    assert bench.points.stamp == 0.0


def test_a_tracker_that_is_not_awaited_runs_in_parallel() -> None:
    with pytest.raises(InvalidValueError, match="parallel"):
        PointTrackerConfig(blocking=False, parallel=False)
