"""The output ports that all trackers share."""

from collections.abc import Callable
from typing import Any, Protocol

from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem

from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.systems.statuses import TrackerStatus


class TrackerReport(Protocol):
    """What a tracker reports at a release."""

    @property
    def points(self) -> TrackedPoints:
        """The tracked points."""

    @property
    def status(self) -> TrackerStatus:
        """Whether the tracker follows the object."""


def DeclareTrackerOutputs(
    system: LeafSystem,
    *,
    report: Callable[[Context], TrackerReport],
    num_points: int,
    prerequisites: set[Any],
) -> None:
    """Declares the output ports `tracked_points` and `status` on a tracker.

    Args:
        system: The tracker.
        report: Returns the tracker's latest report.
        num_points: Number of points, N.
        prerequisites: Tickets of everything that the report depends on.
    """
    system.DeclareAbstractOutputPort(
        "tracked_points",
        lambda: Value(TrackedPoints.lost(num_points, -float("inf"))),
        lambda context, output: output.set_value(report(context).points),
        prerequisites,
    )
    system.DeclareVectorOutputPort(
        "status",
        1,
        lambda context, output: output.SetAtIndex(0, float(report(context).status)),
        prerequisites,
    )
