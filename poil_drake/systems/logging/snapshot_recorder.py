"""Keeps some of the camera pictures of a run, for its summary."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.absent import ABSENT

_REMEMBERED = 64
"""Pictures that wait for their track at most, should the tracker stall."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot:
    """A camera picture and where the points were then.

    Attributes:
        time: Time of capture [s].
        camera: The camera.
        rgb: (H, W, 3) uint8 colour.
        points: (N, 3) where the tracker saw the points in it [m, world]; NaN where it did not.
        target_points: (N, 3) where the reference wanted them then [m, world]; NaN where unknown.
    """

    time: float
    camera: CameraModel
    rgb: np.ndarray
    points: np.ndarray
    target_points: np.ndarray


class SnapshotAlbum:
    """A bounded collection of snapshots, about evenly spaced over however long a run takes."""

    def __init__(self, capacity: int = 48):
        """Makes an empty album.

        Args:
            capacity: How many snapshots it holds at most; when it is full, every other one goes,
                and from then on every other one that comes. At 640 x 480 one takes 0.9 MB.
        """
        if capacity < 2:
            raise InvalidValueError(
                f"An album of {capacity} snapshots.", remedy="Ask for a capacity of at least 2."
            )
        self._capacity, self._stride, self._offered = capacity, 1, 0
        self._snapshots: list[Snapshot] = []
        self._last: Snapshot | None = None

    def add(self, snapshot: Snapshot) -> None:
        """Offers a snapshot; the last one offered is always kept."""
        self._last = snapshot
        if self._offered % self._stride == 0:
            if len(self._snapshots) == self._capacity:
                self._snapshots = self._snapshots[::2]
                self._stride *= 2
            if self._offered % self._stride == 0:
                self._snapshots.append(snapshot)
        self._offered += 1

    @property
    def last_time(self) -> float:
        """Time of capture of the last snapshot offered [s]; minus infinity before the first."""
        return -np.inf if self._last is None else self._last.time

    @property
    def snapshots(self) -> tuple[Snapshot, ...]:
        """What was kept, in order."""
        if self._last is None or self._snapshots[-1] is self._last:
            return tuple(self._snapshots)
        return (*self._snapshots, self._last)

    def nearest_to(self, times: Sequence[float]) -> tuple[Snapshot, ...]:
        """Returns the snapshots nearest to some times [s], in order and each at most once."""
        kept = self.snapshots
        if not kept:
            return ()
        stamps = np.array([snapshot.time for snapshot in kept])
        chosen = {int(np.argmin(np.abs(stamps - time))) for time in times}
        return tuple(kept[index] for index in sorted(chosen))


class SnapshotRecorder(LeafSystem):
    """Puts the tracker's frames into an album, each with what the tracker made of it.

    .. pydrake_system::

        name: SnapshotRecorder
        input_ports:
        - frame
        - tracked_points

    `frame` is an abstract `MultiViewFrame`, or anything else before the first; `tracked_points` are
    `TrackedPoints`, which come later than their frame: their stamp tells which one it is. There
    are no outputs. Periodic updates remember the camera's images, and periodic publish events add
    the one that has been tracked; none is added before the first track, and points that are lost
    are NaN.
    """

    def __init__(
        self,
        *,
        album: SnapshotAlbum,
        camera: CameraModel,
        reference: PointTrajectory,
        period: float,
        offset: float,
        view: int = 0,
    ):
        """Constructs the recorder.

        Args:
            album: Where the snapshots go.
            camera: The camera whose pictures are kept.
            reference: The reference of the N points; its closest configuration is their target.
            period: From one capture to the next [s].
            offset: How long after time 0 to look first [s], e.g. the control period: a publish
                event at the time of a capture would still see what was before.
            view: Which of the frames' cameras that is.
        """
        super().__init__()
        self._album, self._reference = album, reference
        self._camera, self._view = camera, view
        self._nothing = TrackedPoints.lost(reference.positions.shape[1], -np.inf)
        self._frame = self.DeclareAbstractInputPort("frame", Value(ABSENT))
        self._tracked = self.DeclareAbstractInputPort("tracked_points", Value(self._nothing))
        self._images = self.DeclareAbstractState(Value(()))
        self.DeclarePeriodicPublishEvent(period, offset, self._publish)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, offset, self._remember)
        self.DeclareForcedPublishEvent(self._publish)

    def _waiting(self, context: Context) -> tuple[RgbdImage, ...]:
        """Returns the images that are remembered, and the one at the port."""
        images: tuple[RgbdImage, ...] = context.get_abstract_state(self._images).get_value()
        frame = self._frame.Eval(context) if self._frame.HasValue(context) else None
        if not isinstance(frame, MultiViewFrame) or (images and frame.stamp <= images[-1].stamp):
            return images
        return (*images, frame.images[self._view])

    def _tracked_points(self, context: Context) -> TrackedPoints:
        return self._tracked.Eval(context) if self._tracked.HasValue(context) else self._nothing

    def _remember(self, context: Context, state: State) -> None:
        done = self._tracked_points(context).stamp
        images = tuple(image for image in self._waiting(context) if image.stamp > done)
        state.get_mutable_abstract_state(self._images).set_value(images[-_REMEMBERED:])

    def _publish(self, context: Context) -> None:
        tracked = self._tracked_points(context)
        if tracked.stamp <= self._album.last_time:
            return
        for image in self._waiting(context):
            if image.stamp == tracked.stamp:
                self._album.add(self._snapshot(image, tracked))

    def _snapshot(self, image: RgbdImage, tracked: TrackedPoints) -> Snapshot:
        field = point_set_bcsdm(
            tracked.positions, self._reference, BcsdmConfig(), tracked.confidence
        )
        known = np.isfinite(field.tau)
        return Snapshot(
            time=image.stamp,
            camera=self._camera,
            rgb=image.rgb,
            points=tracked.positions,
            target_points=(
                self._reference.positions_at(field.tau)
                if known
                else np.full_like(tracked.positions, np.nan)
            ),
        )
