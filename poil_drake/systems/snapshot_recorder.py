"""Keeps some of the camera pictures of a run, for its summary."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.control.point_set_bcsdm import BcsdmConfig, point_set_bcsdm
from poil_drake.control.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints

_REMEMBERED = 16
"""Frames that wait for their track: more than come in any latency."""


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

    `frame` is an abstract `MultiViewFrame`, or None before the first; `tracked_points` are
    `TrackedPoints`, which come later than their frame: their stamp tells which one it is. There
    are no outputs. Periodic updates remember the frames, and periodic publish events add the one
    that has been tracked; none is added before the first track, and points that are lost are NaN.
    """

    def __init__(
        self,
        *,
        album: SnapshotAlbum,
        reference: PointTrajectory,
        period: float,
        offset: float,
        view: int = 0,
    ):
        """Constructs the recorder.

        Args:
            album: Where the snapshots go.
            reference: The reference of the N points; its closest configuration is their target.
            period: From one capture to the next [s].
            offset: How long after time 0 to look first [s], e.g. the control period: a publish
                event at the time of a capture would still see what was before.
            view: Which of the frame's cameras to keep.
        """
        super().__init__()
        self._album, self._view, self._reference = album, view, reference
        num_points = reference.positions.shape[1]
        self._frame = self.DeclareAbstractInputPort("frame", Value(object()))
        self._tracked = self.DeclareAbstractInputPort(
            "tracked_points", Value(TrackedPoints.lost(num_points, -np.inf))
        )
        self._frames = self.DeclareAbstractState(Value(()))
        self.DeclarePeriodicPublishEvent(period, offset, self._publish)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, offset, self._remember)
        self.DeclareForcedPublishEvent(self._publish)

    def _known_frames(self, context: Context) -> tuple[MultiViewFrame, ...]:
        """Returns the frames that are remembered, and the one at the port."""
        frames: tuple[MultiViewFrame, ...] = context.get_abstract_state(self._frames).get_value()
        frame = self._frame.Eval(context) if self._frame.HasValue(context) else None
        if not isinstance(frame, MultiViewFrame) or (frames and frame.stamp <= frames[-1].stamp):
            return frames
        return (*frames, frame)

    def _remember(self, context: Context, state: State) -> None:
        frames = self._known_frames(context)[-_REMEMBERED:]
        state.get_mutable_abstract_state(self._frames).set_value(frames)

    def _publish(self, context: Context) -> None:
        if not self._tracked.HasValue(context):
            return
        tracked: TrackedPoints = self._tracked.Eval(context)
        if tracked.stamp <= self._album.last_time:
            return
        for frame in self._known_frames(context):
            if frame.stamp == tracked.stamp:
                self._album.add(self._snapshot(frame, tracked))

    def _snapshot(self, frame: MultiViewFrame, tracked: TrackedPoints) -> Snapshot:
        field = point_set_bcsdm(
            tracked.positions, self._reference, BcsdmConfig(), tracked.confidence
        )
        known = np.isfinite(field.tau)
        return Snapshot(
            time=frame.stamp,
            camera=frame.cameras[self._view],
            rgb=frame.images[self._view].rgb,
            points=tracked.positions,
            target_points=(
                self._reference.positions_at(field.tau)
                if known
                else np.full_like(tracked.positions, np.nan)
            ),
        )
