"""Keeps some of a run's camera images for its summary."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.absent import ABSENT

_REMEMBERED = 64
"""Maximum number of images that wait for their track, in case the tracker stalls."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot:
    """A camera image and the points at its capture time.

    Attributes:
        time: Capture time [s].
        camera: The camera.
        rgb: (H, W, 3) uint8 colour.
        points: (N, 3) the tracked points [m, world]; NaN where not observed.
        target_points: (N, 3) the points' targets on the reference [m, world]; NaN if unknown.
    """

    time: float
    camera: CameraModel
    rgb: np.ndarray
    points: np.ndarray
    target_points: np.ndarray


class SnapshotAlbum:
    """A bounded collection of snapshots, about evenly spaced over a run of any duration."""

    def __init__(self, capacity: int = 48):
        """Creates an empty album.

        Args:
            capacity: Maximum number of snapshots, at least 2. A full album drops every other
                snapshot, and from then on keeps new snapshots half as often. The last snapshot is
                kept in addition. A 640 x 480 snapshot takes 0.9 MB.
        """
        self._capacity, self._stride, self._offered = capacity, 1, 0
        self._snapshots: list[Snapshot] = []
        self._last: Snapshot | None = None

    def add(self, snapshot: Snapshot) -> None:
        """Offers a snapshot to the album, which always keeps the last one offered."""
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
        """Capture time of the last snapshot offered [s]; minus infinity before the first."""
        return -np.inf if self._last is None else self._last.time

    @property
    def snapshots(self) -> tuple[Snapshot, ...]:
        """The snapshots kept, in the order in which they were offered."""
        if self._last is None or self._snapshots[-1] is self._last:
            return tuple(self._snapshots)
        return (*self._snapshots, self._last)

    def nearest_to(self, times: Sequence[float]) -> tuple[Snapshot, ...]:
        """Returns the kept snapshot nearest to each time [s], in the album's order, each once."""
        kept = self.snapshots
        if not kept:
            return ()
        stamps = np.array([snapshot.time for snapshot in kept])
        chosen = {int(np.argmin(np.abs(stamps - time))) for time in times}
        return tuple(kept[index] for index in sorted(chosen))


class SnapshotRecorder(LeafSystem):
    """Collects tracked images in an album, each with the points that were tracked in it.

    .. pydrake_system::

        name: SnapshotRecorder
        input_ports:
        - frame
        - tracked_points

    `frame` is an abstract `MultiViewFrame`, or any other value before the first. `tracked_points`
    are `TrackedPoints`; they arrive later than their frame, and have the same stamp. There are no
    outputs. Periodic updates store the camera's images in the context. Periodic publish events add
    an image to the album once its points arrive; a snapshot's lost points are NaN.
    """

    def __init__(
        self,
        *,
        album: SnapshotAlbum,
        camera: CameraModel,
        reference: PointTrajectory,
        period: float,
        offset: float,
    ):
        """Constructs the recorder.

        Args:
            album: Where the snapshots go.
            camera: The first of the frames' cameras. Only its images are kept.
            reference: The reference motion, whose closest configuration gives the points' targets.
            period: Period of the updates and publish events [s], e.g. the tracker's.
            offset: Time of the first of these events [s], e.g. the control period. An event at the
                time of a capture would still see the previous frame.
        """
        super().__init__()
        self._album, self._camera, self._reference = album, camera, reference
        no_track = TrackedPoints.lost(reference.positions.shape[1], -np.inf)
        self._frame = self.DeclareAbstractInputPort("frame", Value(ABSENT))
        self._tracked = self.DeclareAbstractInputPort("tracked_points", Value(no_track))
        self._images = self.DeclareAbstractState(Value(()))
        self.DeclarePeriodicPublishEvent(period, offset, self._publish)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, offset, self._remember)
        self.DeclareForcedPublishEvent(self._publish)

    def _waiting(self, context: Context) -> tuple[RgbdImage, ...]:
        """Returns the stored images, and the image at the port if it is newer."""
        images: tuple[RgbdImage, ...] = context.get_abstract_state(self._images).get_value()
        frame = self._frame.Eval(context)
        if not isinstance(frame, MultiViewFrame) or (images and frame.stamp <= images[-1].stamp):
            return images
        return (*images, frame.images[0])

    def _remember(self, context: Context, state: State) -> None:
        done = self._tracked.Eval(context).stamp
        images = tuple(image for image in self._waiting(context) if image.stamp > done)
        state.get_mutable_abstract_state(self._images).set_value(images[-_REMEMBERED:])

    def _publish(self, context: Context) -> None:
        tracked = self._tracked.Eval(context)
        if tracked.stamp <= self._album.last_time:
            return
        for image in self._waiting(context):
            if image.stamp == tracked.stamp:
                self._album.add(self._snapshot(image, tracked))

    def _snapshot(self, image: RgbdImage, tracked: TrackedPoints) -> Snapshot:
        field = point_set_bcsdm(
            tracked.positions, self._reference, BcsdmConfig(), tracked.confidence
        )
        return Snapshot(
            time=image.stamp,
            camera=self._camera,
            rgb=image.rgb,
            points=tracked.positions,
            target_points=field.target_points,
        )
