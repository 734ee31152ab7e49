"""How fast the robot's time may pass on this machine: a run that fell behind proves nothing."""

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

import pytest


class Pace(NamedTuple):
    """How well a run kept up with its clock; times are the robot's.

    Attributes:
        held_up: The largest lag of one of its processes [s].
        busy: The median of the ticks' durations, as a share of their period.
        blind: How long the first track took [s].
    """

    held_up: float
    busy: float = 0.0
    blind: float = 0.0

    def __str__(self) -> str:
        return (
            f"a process was {1e3 * self.held_up:.1f} ms behind, ticks took {self.busy:.0%} of "
            f"their period (median), and the first track {self.blind:.2f} s"
        )


SLOWEST = 0.125
"""The slowest time scale that is tried."""

KEPT = Pace(held_up=0.02, busy=math.inf, blind=1.0)
"""The worst pace of a run that says something about the code."""

ROOM = Pace(held_up=0.008, busy=0.55, blind=0.6)
"""The worst pace of a trial run that leaves room to spare for all that follow.

Images make single ticks long, which the loop then catches up with: their median is what counts.
"""

T = TypeVar("T")


def first_kept(
    scales: Iterable[float], attempt: Callable[[float], tuple[T, Pace]], *, worst: Pace = KEPT
) -> T:
    """Returns the result of the first attempt that kept up; skips the test if none did.

    Args:
        scales: Seconds of the robot's time per second, in the order in which they are tried.
        attempt: Makes a run at a time scale, and returns its result and how well it kept up.
        worst: The worst pace that will do.
    """
    found = []
    for scale in scales:
        result, pace = attempt(scale)
        if all(had <= allowed for had, allowed in zip(pace, worst, strict=True)):
            return result
        found.append(f"at a time scale of {scale:.3g} {pace}")
    pytest.skip(f"This machine does not keep up: {'; '.join(found)}.")


def slower(scale: float, *, step: float = 0.5) -> list[float]:
    """Returns a time scale, that times `step`, and so on down to the slowest that is tried."""
    found = [scale]
    while found[-1] > SLOWEST:
        found.append(max(step * found[-1], SLOWEST))
    return found
