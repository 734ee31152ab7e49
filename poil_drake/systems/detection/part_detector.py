"""Finds the object's functional part in the camera images."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.errors import DetectionError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.perception.detectors.protocol import Detector, PartMasks
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import CameraModel
from poil_drake.perception.robot_filter import without_robot
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.cameras.camera_ports import CameraPorts
from poil_drake.systems.capture_and_release import CaptureAndRelease
from poil_drake.systems.capture_timing import Captured, CaptureTiming, SimulatedDelay
from poil_drake.systems.statuses import DetectorStatus


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection(SharedOnCopy):
    """The result of the latest search. The default values mean that no search has ended.

    Attributes:
        status: Whether the part was found.
        request: The value of the port `request` that the search answers; minus infinity before the
            first search.
        masks: Masks of the object and its part in each image; None until the part is first found.
        cloud: The part's points [m, world]; None until the part is first found.
    """

    status: DetectorStatus = DetectorStatus.WAITING
    request: float = -np.inf
    masks: PartMasks | None = None
    cloud: PointCloud | None = None


class PartDetector(LeafSystem):
    """Finds the functional part in the first images, and again on request.

    .. pydrake_system::

        name: PartDetector
        input_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.rgbd_image
        - <camera>.image_time
        - <camera>.label_image
        - request
        - position_measured
        - width_measured
        output_ports:
        - part_cloud
        - masks
        - status
        - frame
        - times

    `request` (1,) is a counter: when it increases, the next capture starts a new search. It is
    optional; NaN requests nothing. `position_measured` (7,) [rad] and `width_measured` (1,) [m] are
    the robot's; if they are connected, the robot is removed from the depth images before the
    search, and a capture waits until the position is known. If label images are connected, a
    capture waits until all of them have pixels. Every output is a function of the state alone:

    - `part_cloud`: a `PointCloud` [m, world]; `ABSENT` until the part is first found.
    - `masks`: `PartMasks`; `ABSENT` until the part is first found. Each successful search gives a
      new object, so consumers can compare by identity.
    - `status` (1,): a `DetectorStatus`; WAITING before the first result. After a failed search it
      is NOT_FOUND, while `part_cloud` and `masks` keep what was found earlier.
    - `frame`: the `MultiViewFrame` of the last capture; `ABSENT` before the first.
    - `times` (3,) [s]: the time of the last capture, the time of the last release, and the capture
      time of the last released result; minus infinity until known.
    """

    def __init__(
        self,
        *,
        detector: Detector,
        cameras: Sequence[CameraModel],
        object_label: str,
        part_label: str,
        timing: CaptureTiming | None = None,
        label_ids: Mapping[str, Sequence[int]] | None = None,
        robot: PandaModel | None = None,
        fusion: FusionConfig | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the system.

        Args:
            detector: Finds the part in a frame.
            cameras: The cameras' models, in the order of the frames' images.
            object_label: The object to find, e.g. "mug".
            part_label: The object's functional part, e.g. "handle".
            timing: When frames are captured and results released; None: frames are captured at
                multiples of 1/8 s, and results are released immediately.
            label_ids: The meaning of the labels (see `MultiViewFrame`); None: no label ports.
            robot: The robot that the views may show; None for none.
            fusion: How images are merged into a cloud; None: the default settings.
            stopwatch: Records the time of captures ("capture") and of searches ("detection").
        """
        super().__init__()
        self._detector = detector
        self._labels = {"object_label": object_label, "part_label": part_label}
        self._fusion, self._stopwatch = fusion, stopwatch or Stopwatch()
        self._cameras = CameraPorts(system=self, cameras=cameras, label_ids=label_ids)
        self._request = self.DeclareVectorInputPort("request", 1)
        self._robot = robot
        self._position = self.DeclareVectorInputPort("position_measured", 7)
        self._width = self.DeclareVectorInputPort("width_measured", 1)
        self._frame = self.DeclareAbstractState(Value(ABSENT))
        self._detections = CaptureAndRelease(
            system=self,
            timing=timing or SimulatedDelay(latency=0.0),
            nothing=Detection(),
            wanted=self._wanted,
            begin=self._begin,
            thread="detector's thread",
        )
        for name, field in (("part_cloud", "cloud"), ("masks", "masks")):

            def calc(context: Context, output: AbstractValue, field: str = field) -> None:
                found = getattr(self._detections.result(context), field)
                output.set_value(ABSENT if found is None else found)

            self.DeclareAbstractOutputPort(
                name, lambda: Value(ABSENT), calc, self._detections.tickets
            )
        self.DeclareVectorOutputPort("status", 1, self._calc_status, self._detections.tickets)
        self.DeclareStateOutputPort("frame", self._frame)
        self._detections.DeclareTimesPort()

    def close(self) -> None:
        """Finishes the search in progress. Later captures raise `StationError`."""
        self._detections.close()

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self._detections.result(context).status))

    def _requested(self, context: Context) -> float:
        request = self._request.Eval(context)[0] if self._request.HasValue(context) else 0.0
        before = self._detections.result(context).request
        return before if np.isnan(request) else float(request)

    def _posture(self, context: Context) -> tuple[np.ndarray, float] | None:
        """Returns the robot's joint positions [rad] and its fingers' opening [m], if connected."""
        if not (self._position.HasValue(context) and self._width.HasValue(context)):
            return None
        return self._position.Eval(context).copy(), float(self._width.Eval(context)[0])

    def _wanted(self, context: Context, previous: Captured | None) -> bool:
        if previous is not None and previous.time > self._detections.capture_time(context):
            return False  # The result of that search has not been released yet.
        before: Detection = self._detections.result(context)
        return before.status is DetectorStatus.WAITING or self._requested(context) > before.request

    def _begin(
        self, context: Context, state: State, previous: Captured | None
    ) -> Callable[[], Detection] | None:
        posture = self._posture(context)
        if self._cameras.labels_empty(context) or (posture and np.isnan(posture[0]).any()):
            return None
        with self._stopwatch.measure("capture"):
            frame = self._cameras.capture(context)
        if frame is None:
            return None
        state.get_mutable_abstract_state(self._frame).set_value(frame)
        before, request = self._detections.result(context), self._requested(context)

        def find() -> Detection:
            try:
                with self._stopwatch.measure("detection"):
                    seen = frame
                    if self._robot is not None and posture is not None:
                        seen = without_robot(frame, self._robot, *posture)
                    masks = self._detector.detect(seen, **self._labels)
                    cloud = fuse_views(frame, masks.part_masks, self._fusion)
            except DetectionError:  # The part is not found, or has no pixel with valid depth.
                return replace(before, status=DetectorStatus.NOT_FOUND, request=request)
            return Detection(status=DetectorStatus.FOUND, request=request, masks=masks, cloud=cloud)

        return find
