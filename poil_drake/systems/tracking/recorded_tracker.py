"""A stand-in for the point tracker that repeats what one said in a run that is replayed."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.statuses import TrackerStatus

_ROUNDING = 1e-6


@dataclass(frozen=True, kw_only=True)
class RecordedTrack:
    """A track that was released.

    Attributes:
        captured: When its images were looked at [s].
        released: When it was released [s].
        track: The points.
        status: What the tracker thought of them.
    """

    captured: float
    released: float
    track: TrackedPoints
    status: TrackerStatus


class RecordedTracker(LeafSystem):
    """Releases recorded tracks when they were released.

    .. pydrake_system::

        name: RecordedTracker
        output_ports:
        - tracked_points
        - status
        - times

    The outputs are those of `PointTracker`, functions of the state, which changes in unrestricted
    updates. Before the first release `tracked_points` are lost with a stamp of minus infinity,
    `status` is WAITING, and `times` are minus infinity.
    """

    def __init__(self, *, tracks: Sequence[RecordedTrack], num_points: int, period: float):
        """Constructs the tracker.

        Args:
            tracks: The tracks in the order of their releases.
            num_points: How many points they have, N.
            period: How often to look if one is due [s]: the control period.
        """
        super().__init__()
        self._tracks = tuple(tracks)
        self._releases = [track.released for track in self._tracks]
        self._nothing = RecordedTrack(
            captured=-np.inf,
            released=-np.inf,
            track=TrackedPoints.lost(num_points, -np.inf),
            status=TrackerStatus.WAITING,
        )
        # How many were released.
        self._count = self.DeclareDiscreteState(1)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        known = {self.discrete_state_ticket(self._count)}
        self.DeclareAbstractOutputPort(
            "tracked_points", lambda: Value(self._nothing.track), self._calc_points, known
        )
        self.DeclareVectorOutputPort("status", 1, self._calc_status, known)
        self.DeclareVectorOutputPort("times", 3, self._calc_times, known)

    def _look(self, context: Context, state: State) -> None:
        count = bisect_right(self._releases, context.get_time() + _ROUNDING)
        state.get_mutable_discrete_state(self._count).SetFromVector(np.array([float(count)]))

    def _newest(self, context: Context) -> RecordedTrack:
        count = int(context.get_discrete_state(self._count)[0])
        return self._tracks[count - 1] if count else self._nothing

    def _calc_points(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._newest(context).track)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, float(self._newest(context).status))

    def _calc_times(self, context: Context, output: BasicVector) -> None:
        newest = self._newest(context)
        output.SetFromVector(np.array([newest.captured, newest.released, newest.captured]))
