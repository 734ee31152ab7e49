"""How fast the robot's time may pass on this machine: a run that fell behind proves nothing."""

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

import pytest


class Pace(NamedTuple):
    """How well a run kept up with its clock.

    Attributes:
        held_up: The longest time for which a process was held up [s of the robot's time].
        busy: The 99th percentile of the ticks' durations, as a share of their period.
    """

    held_up: float
    busy: float

    def __str__(self) -> str:
        return (
            f"a process was held up for {1e3 * self.held_up:.1f} ms of the robot's time, "
            f"and ticks took {self.busy:.0%} of their period (p99)"
        )


SLOWEST = 0.125
"""The slowest time scale that is tried."""

KEPT = Pace(held_up=0.02, busy=math.inf)
"""The worst pace of a run that says something about the code."""

ROOM = Pace(held_up=0.005, busy=1.0)
"""The worst pace of a trial run that leaves room to spare for all that follow."""

T = TypeVar("T")


def first_kept(
    scales: Iterable[float], attempt: Callable[[float], tuple[T, Pace]], *, worst: Pace = KEPT
) -> tuple[float, T]:
    """Returns the first time scale whose attempt kept up, and its result; skips the test without.

    Args:
        scales: Seconds of the robot's time per second, in the order in which they are tried.
        attempt: Makes a run at a time scale, and returns its result and how well it kept up.
        worst: The worst pace that will do.
    """
    found = []
    for scale in scales:
        result, pace = attempt(scale)
        if pace.held_up < worst.held_up and pace.busy < worst.busy:
            return scale, result
        found.append(f"at a time scale of {scale:g} {pace}")
    pytest.skip(f"This machine does not keep up: {'; '.join(found)}.")


def halvings(scale: float) -> list[float]:
    """Returns a time scale, its half, and so on down to the slowest that is tried."""
    return [scale, *(halvings(0.5 * scale) if scale > SLOWEST else [])]


def repeated(scale: float) -> list[float]:
    """Returns a time scale twice, as machines stumble, and its halves."""
    return [scale, *halvings(scale)]
