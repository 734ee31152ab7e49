"""How a run brings the robot to rest before anything else is done."""

from collections.abc import Iterator
from contextlib import contextmanager

from pydrake.systems.framework import Context

from poil_drake.diagrams.loop.closed_loop import ClosedLoop
from poil_drake.diagrams.run.real_time_loop import RealTimeLoop
from poil_drake.diagrams.station.station import Station

_LONGEST_BRAKING = 1.0
"""Longer than the supervisor ever takes to bring the arm to rest [s]."""


def Brake(loop: ClosedLoop, root: Context, pace: RealTimeLoop) -> None:
    """Goes on until the supervisor has brought the arm to rest."""
    context = loop.supervisor.GetMyContextFromRoot(root)
    period, end = loop.station.scenario.poil.rates.control, root.get_time() + _LONGEST_BRAKING
    while loop.supervisor.commanded_motion(context).velocity.any() and root.get_time() < end:
        pace.AdvanceTo(root.get_time() + period)


@contextmanager
def Resting(station: Station) -> Iterator[None]:
    """Brings the robot to rest at the end of a block, before anything else is done."""
    try:
        yield
    finally:
        station.Rest()
