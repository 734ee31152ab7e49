"""A stand-in for the point tracker that repeats the tracks of a recorded run."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.statuses import TrackerStatus
from poil_drake.systems.tracking.tracker_outputs import DeclareTrackerOutputs

_ROUNDING = 1e-6
"""Times closer than this [s] are the same."""


@dataclass(frozen=True, kw_only=True)
class RecordedTrack:
    """A result that the tracker of a recorded run released.

    Attributes:
        captured: Capture time of the images [s].
        released: Release time [s].
        points: The tracked points.
        status: The tracker's status.
    """

    captured: float
    released: float
    points: TrackedPoints
    status: TrackerStatus


class RecordedTracker(LeafSystem):
    """Releases recorded tracks at their recorded times.

    .. pydrake_system::

        name: RecordedTracker
        output_ports:
        - tracked_points
        - status
        - times

    The outputs are those of `PointTracker`, functions of the state, which changes in unrestricted
    updates. Before the first release, all points are lost with a stamp of minus infinity, `status`
    is WAITING, and `times` are minus infinity.
    """

    def __init__(self, *, tracks: Sequence[RecordedTrack], num_points: int, period: float):
        """Constructs the tracker.

        Args:
            tracks: The tracks in the order of their releases.
            num_points: Number of points, N.
            period: Time between checks for a due track [s]: the control period.
        """
        super().__init__()
        nothing = RecordedTrack(
            captured=-np.inf,
            released=-np.inf,
            points=TrackedPoints.lost(num_points, -np.inf),
            status=TrackerStatus.WAITING,
        )
        self._tracks = (nothing, *tracks)
        self._releases = [track.released for track in tracks]
        self._num_released = self.DeclareDiscreteState(1)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._release)
        state = {self.discrete_state_ticket(self._num_released)}
        DeclareTrackerOutputs(self, report=self._newest, num_points=num_points, prerequisites=state)
        self.DeclareVectorOutputPort("times", 3, self._calc_times, state)

    def _release(self, context: Context, state: State) -> None:
        count = bisect_right(self._releases, context.get_time() + _ROUNDING)
        state.get_mutable_discrete_state(self._num_released).SetAtIndex(0, count)

    def _newest(self, context: Context) -> RecordedTrack:
        return self._tracks[int(context.get_discrete_state(self._num_released)[0])]

    def _calc_times(self, context: Context, output: BasicVector) -> None:
        newest = self._newest(context)
        output.SetFromVector([newest.captured, newest.released, newest.captured])
