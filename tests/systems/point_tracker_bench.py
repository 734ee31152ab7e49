"""A scene, a tracker whose points depend on every frame, and both in a diagram with the system."""

from collections.abc import Callable

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U
from system_bench import SystemBench

from poil_drake.perception.detectors import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import Absent
from poil_drake.systems.capture_timing import CaptureTiming
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

    def __init__(self, frozen_from: float = np.inf, moving: float = 1.0):
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
        timing: CaptureTiming | None = None,
        min_interval: float = 0.0,
        once: bool = False,
        tracker: object | None = None,
        scene: Scene | None = None,
        with_stamps: bool = False,
        moving: float = 1.0,
        query_points: np.ndarray | None = QUERY,
        masks: PartMasks | Absent = MASKS,
        stopwatch: Stopwatch | None = None,
    ):
        builder = DiagramBuilder()
        self.scene = builder.AddSystem(scene or Scene(moving=moving))
        dut = PointTracker(
            tracker=tracker or SummingTracker(),
            cameras=[CAMERA],
            num_points=N,
            query_points=query_points,
            timing=timing,
            min_interval=min_interval,
            once=once,
            stopwatch=stopwatch,
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
