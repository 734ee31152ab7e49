"""Keeps some of the camera pictures of a run, for its summary."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.perception.images import CameraModel, MultiViewFrame


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot:
    """A camera picture and where the points were then.

    Attributes:
        time: Time of capture [s].
        camera: The camera.
        rgb: (H, W, 3) uint8 colour.
        points: (N, 3) the points that the controller was given [m, world]; NaN where unknown.
        target_points: (N, 3) where the reference wanted them [m, world]; NaN where unknown.
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
    """Puts the tracker's frames, as they come, into an album.

    .. pydrake_system::

        name: SnapshotRecorder
        input_ports:
        - frame
        - points
        - target_points

    `frame` is an abstract `MultiViewFrame`, or None before the first; `points` and `target_points`
    are (3N,) row-major [m, world], and may stay unconnected. There are no outputs. Frames are
    looked at in periodic publish events, soon after each capture, so that the points belong to the
    picture; a frame is taken once.
    """

    def __init__(
        self,
        *,
        album: SnapshotAlbum,
        num_points: int,
        period: float,
        offset: float,
        view: int = 0,
    ):
        """Constructs the recorder.

        Args:
            album: Where the snapshots go.
            num_points: Number of points, N.
            period: The tracker's period [s].
            offset: How long after a capture to look [s], e.g. the control period: a publish event
                at the time of a capture would still see the frame before.
            view: Which of the frame's cameras to keep.
        """
        super().__init__()
        self._album, self._view = album, view
        # Which frame the album has already. Nothing but the album depends on it.
        self._taken: MultiViewFrame | None = None
        self._unknown = np.full(3 * num_points, np.nan)
        self._frame = self.DeclareAbstractInputPort("frame", Value(object()))
        self._points = self.DeclareVectorInputPort("points", 3 * num_points)
        self._target_points = self.DeclareVectorInputPort("target_points", 3 * num_points)
        self.DeclarePeriodicPublishEvent(period, offset, self._publish)
        self.DeclareForcedPublishEvent(self._publish)

    def _publish(self, context: Context) -> None:
        frame = self._frame.Eval(context) if self._frame.HasValue(context) else None
        if not isinstance(frame, MultiViewFrame) or frame is self._taken:
            return
        self._taken = frame
        points, target_points = (
            (port.Eval(context) if port.HasValue(context) else self._unknown).reshape(-1, 3).copy()
            for port in (self._points, self._target_points)
        )
        image = frame.images[self._view]
        self._album.add(
            Snapshot(
                time=image.stamp,
                camera=frame.cameras[self._view],
                rgb=image.rgb,
                points=points,
                target_points=target_points,
            )
        )
