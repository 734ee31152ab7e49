"""Looks for the object's functional part in the camera images."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.errors import DetectionError
from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.perception.detectors import protocol
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.runtime.background_thread import Background
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.cameras.camera_ports import CameraPorts
from poil_drake.systems.statuses import DetectorStatus
from poil_drake.systems.tracking.recorded_schedule import RecordedSchedule
from poil_drake.systems.tracking.release_schedule import Captured


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection(SharedOnCopy):
    """What is known of the part.

    Attributes:
        status: How the last search went.
        request: The value of the request counter that it answered.
        masks: Where object and part are seen; None before anything was found.
        cloud: The part's points [m, world]; None before anything was found.
    """

    status: DetectorStatus = DetectorStatus.WAITING
    request: float = -np.inf
    masks: protocol.PartMasks | None = None
    cloud: PointCloud | None = None


@dataclass(frozen=True, eq=False)
class _Search(SharedOnCopy):
    """A search that is being done; it is shared by all copies of the state that holds it."""

    result: Future[Detection]
    begun: float


def find_part(
    detector: protocol.PartDetector,
    frame: MultiViewFrame,
    *,
    object_label: str,
    part_label: str,
    fusion: FusionConfig | None = None,
) -> tuple[protocol.PartMasks, PointCloud]:
    """Returns where the part is seen in each view, and its fused cloud (world).

    Raises:
        DetectionError: if the part is not found, or has no pixel with depth to trust.
    """
    masks = detector.detect(frame, object_label=object_label, part_label=part_label)
    return masks, fuse_views(frame, masks.part_masks, fusion)


class PartDetector(LeafSystem):
    """Finds the functional part in the first images, and again on request.

    .. pydrake_system::

        name: PartDetector
        input_ports:
        - <camera>.rgb_image
        - <camera>.depth_image
        - <camera>.image_time
        - <camera>.label_image
        - request
        output_ports:
        - part_cloud
        - masks
        - status
        - frame
        - times

    `request` (1,) is a counter: each time it is found to have grown, the search runs anew (at the
    next tick of `period`). It may stay unconnected; NaN asks for nothing. Every output is a
    function of the state alone:

    - `part_cloud`: a `PointCloud` [m, world], `ABSENT` before the part was found.
    - `masks`: `PartMasks`, `ABSENT` before the part was found. Each search that succeeds gives a
      new object, so that consumers can tell by identity.
    - `status` (1,): a `DetectorStatus`; WAITING before the first complete set of images. After a
      search that failed it is NOT_FOUND, while the other outputs keep what was found earlier.
    - `frame`: the `MultiViewFrame` of the last search that was begun; `ABSENT` before the first.
    - `times` (3,) [s]: when the last search was begun, when the last result was taken, and when
      the search for it was begun; minus infinity before.

    Where label images are connected, a set of images is complete with them only. A search is done
    at its tick, or, with `blocking` off, on a thread, and its result is taken at the first tick at
    which it is there; no other search begins meanwhile. `close` ends that thread.

    In a replay searches begin, and their results are taken, when they were `recorded`, whatever is
    requested.
    """

    def __init__(
        self,
        *,
        detector: protocol.PartDetector,
        cameras: Sequence[CameraModel],
        object_label: str,
        part_label: str,
        period: float,
        offset: float = 0.0,
        label_ids: Mapping[str, Sequence[int]] | None = None,
        fusion: FusionConfig | None = None,
        blocking: bool = True,
        recorded: RecordedSchedule | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the system.

        Args:
            detector: What searches.
            cameras: The cameras' models, in the order of the views.
            object_label: The object to find.
            part_label: Its functional part.
            period: How often to see whether there is something to do [s].
            offset: When to see that first [s].
            label_ids: What render labels stand for; None: there are no label ports.
            fusion: How views are merged into a cloud.
            blocking: Whether a search is awaited. On hardware it must not be.
            recorded: When searches were begun, and their results taken, in a run that is replayed;
                `period` only tells how often to look if one is due.
            stopwatch: Where to note how long captures take ("capture"), and searches
                ("detection").
        """
        super().__init__()
        self._detector = detector
        self._labels = {"object_label": object_label, "part_label": part_label}
        self._fusion, self._stopwatch = fusion, stopwatch or Stopwatch()
        self._background = None if blocking else Background("detector's thread")
        self._cameras = CameraPorts(system=self, cameras=cameras, label_ids=label_ids)
        self._request = self.DeclareVectorInputPort("request", 1)
        self._state = self.DeclareAbstractState(Value(Detection()))
        self._search = self.DeclareAbstractState(Value(ABSENT))
        self._frame = self.DeclareAbstractState(Value(ABSENT))
        self._times = self.DeclareDiscreteState(np.full(3, -np.inf))
        self._recorded, self._queue = recorded, self.DeclareAbstractState(Value(()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period, offset, self._update if recorded is None else self._repeat
        )
        known = {self.abstract_state_ticket(self._state)}
        for name, field in (("part_cloud", "cloud"), ("masks", "masks")):

            def calc(context: Context, output: AbstractValue, field: str = field) -> None:
                found = getattr(self._detection(context), field)
                output.set_value(ABSENT if found is None else found)

            self.DeclareAbstractOutputPort(name, lambda: Value(ABSENT), calc, known)
        self.DeclareVectorOutputPort("status", 1, self._calc_status, known)
        self.DeclareStateOutputPort("frame", self._frame)
        self.DeclareStateOutputPort("times", self._times)

    def _detection(self, context: Context) -> Detection:
        return context.get_abstract_state(self._state).get_value()

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self._detection(context).status))

    def close(self) -> None:
        """Ends the thread of searches, after the one in hand. No search may follow."""
        if self._background is not None:
            self._background.close()

    def _update(self, context: Context, state: State) -> None:
        search = context.get_abstract_state(self._search).get_value()
        if isinstance(search, _Search):
            if search.result.done():
                self._set(context, state, search.result.result(), search.begun)
                state.get_mutable_abstract_state(self._search).set_value(ABSENT)
            return
        before = self._detection(context)
        connected = self._request.HasValue(context)
        request = float(self._request.Eval(context)[0]) if connected else 0.0
        if before.status is not DetectorStatus.WAITING and not request > before.request:
            return
        frame = self._capture(context)
        if frame is None:
            return
        self._note(context, state, frame)
        now = context.get_time()
        request = before.request if np.isnan(request) else request
        if self._background is None:
            self._set(context, state, self._find(before, frame, request), now)
        else:
            result = self._background.submit(self._find, before, frame, request)
            state.get_mutable_abstract_state(self._search).set_value(_Search(result, now))

    def _repeat(self, context: Context, state: State) -> None:
        """Does what is due by the recording."""
        assert self._recorded is not None
        now = context.get_time()
        queue: tuple[Captured, ...] = context.get_abstract_state(self._queue).get_value()
        if self._recorded.capture_tick(now) > (queue[-1].tick if queue else -1):
            frame = self._capture(context)
            if frame is not None:
                self._note(context, state, frame)
                found = self._find(self._detection(context), frame, -np.inf)
                queue = self._recorded.added(queue, now, (found, now))
                state.get_mutable_abstract_state(self._queue).set_value(queue)
        due = self._recorded.due(queue, now)
        if due is not None:
            found, begun = due.item
            if begun > context.get_discrete_state(self._times)[2]:
                self._set(context, state, found, begun)

    def _capture(self, context: Context) -> MultiViewFrame | None:
        """Returns a complete set of images, or None."""
        if self._cameras.labels_empty(context):
            return None
        with self._stopwatch.measure("capture"):
            return self._cameras.capture(context)

    def _note(self, context: Context, state: State, frame: MultiViewFrame) -> None:
        state.get_mutable_abstract_state(self._frame).set_value(frame)
        state.get_mutable_discrete_state(self._times).SetAtIndex(0, context.get_time())

    def _find(self, before: Detection, frame: MultiViewFrame, request: float) -> Detection:
        try:
            with self._stopwatch.measure("detection"):
                masks, cloud = find_part(self._detector, frame, fusion=self._fusion, **self._labels)
        except DetectionError:
            return replace(before, status=DetectorStatus.NOT_FOUND, request=request)
        return Detection(status=DetectorStatus.FOUND, request=request, masks=masks, cloud=cloud)

    def _set(self, context: Context, state: State, detection: Detection, begun: float) -> None:
        state.get_mutable_abstract_state(self._state).set_value(detection)
        times = state.get_mutable_discrete_state(self._times)
        times.SetAtIndex(1, context.get_time())
        times.SetAtIndex(2, begun)
