"""Looks for the object's functional part in the camera images."""

from collections.abc import Mapping, Sequence
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
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.camera_ports import CameraPorts
from poil_drake.systems.statuses import DetectorStatus
from poil_drake.systems.stopwatch import Stopwatch


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

    `request` (1,) is a counter: each time it is found to have grown, the search runs anew (at the
    next tick of `period`). It may stay unconnected; NaN asks for nothing. Every output is a
    function of the state alone:

    - `part_cloud`: a `PointCloud` [m, world], `ABSENT` before the part was found.
    - `masks`: `PartMasks`, `ABSENT` before the part was found. Each search that succeeds gives a
      new object, so that consumers can tell by identity.
    - `status` (1,): a `DetectorStatus`; WAITING before the first complete set of images. After a
      search that failed it is NOT_FOUND, while the other outputs keep what was found earlier.
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
            stopwatch: Where to note how long captures take ("capture"), and searches
                ("detection").
        """
        super().__init__()
        self._detector = detector
        self._labels = {"object_label": object_label, "part_label": part_label}
        self._fusion, self._stopwatch = fusion, stopwatch or Stopwatch()
        self._cameras = CameraPorts(system=self, cameras=cameras, label_ids=label_ids)
        self._request = self.DeclareVectorInputPort("request", 1)
        self._state = self.DeclareAbstractState(Value(Detection()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, offset, self._update)
        known = {self.abstract_state_ticket(self._state)}
        for name, field in (("part_cloud", "cloud"), ("masks", "masks")):

            def calc(context: Context, output: AbstractValue, field: str = field) -> None:
                found = getattr(self._detection(context), field)
                output.set_value(ABSENT if found is None else found)

            self.DeclareAbstractOutputPort(name, lambda: Value(ABSENT), calc, known)
        self.DeclareVectorOutputPort("status", 1, self._calc_status, known)

    def _detection(self, context: Context) -> Detection:
        return context.get_abstract_state(self._state).get_value()

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self._detection(context).status))

    def _update(self, context: Context, state: State) -> None:
        before = self._detection(context)
        connected = self._request.HasValue(context)
        request = float(self._request.Eval(context)[0]) if connected else 0.0
        if before.status is not DetectorStatus.WAITING and not request > before.request:
            return
        with self._stopwatch.measure("capture"):
            frame = self._cameras.capture(context)
        if frame is None:
            return
        request = before.request if np.isnan(request) else request
        try:
            with self._stopwatch.measure("detection"):
                masks, cloud = find_part(self._detector, frame, fusion=self._fusion, **self._labels)
            after = Detection(
                status=DetectorStatus.FOUND, request=request, masks=masks, cloud=cloud
            )
        except DetectionError:
            after = replace(before, status=DetectorStatus.NOT_FOUND, request=request)
        state.get_mutable_abstract_state(self._state).set_value(after)
