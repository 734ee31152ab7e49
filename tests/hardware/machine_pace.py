"""The time scale that this machine keeps up with; a run that falls behind proves nothing."""

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

import pytest


class Pace(NamedTuple):
    """How well a run kept up with the clock; times are the robot's.

    Attributes:
        lag: Largest delay of any of its processes behind the clock [s].
        load: Median duration of the ticks, as a share of their period.
        first_track: Time until the first track [s].
    """

    lag: float
    load: float = 0.0
    first_track: float = 0.0

    def __str__(self) -> str:
        return (
            f"a process was {1e3 * self.lag:.1f} ms behind, ticks took {self.load:.0%} of "
            f"their period (median), and the first track took {self.first_track:.2f} s"
        )


SLOWEST = 0.125
"""The slowest time scale that is tried."""

KEPT = Pace(lag=0.02, load=math.inf, first_track=1.0)
"""The worst pace of a run whose result counts."""

ROOM = Pace(lag=0.008, load=0.55, first_track=0.6)
"""The worst pace of a trial run that leaves a margin for the runs that follow.

Images make single ticks long, but the loop catches up, so the median counts.
"""

T = TypeVar("T")


def first_that_keeps_up(
    scales: Iterable[float], attempt: Callable[[float], tuple[T, Pace]], *, worst: Pace = KEPT
) -> T:
    """Returns the result of the first attempt that kept up; skips the test if none did.

    Args:
        scales: Seconds of the robot's time per second, in the order in which they are tried.
        attempt: Runs at a time scale; returns the result and the pace.
        worst: The worst pace that is accepted.
    """
    failures = []
    for scale in scales:
        result, pace = attempt(scale)
        if all(had <= allowed for had, allowed in zip(pace, worst, strict=True)):
            return result
        failures.append(f"at a time scale of {scale:.3g} {pace}")
    pytest.skip(f"This machine does not keep up: {'; '.join(failures)}.")


def slower_scales(scale: float, *, step: float = 0.5) -> list[float]:
    """Returns a time scale, `step` times that, and so on, down to the slowest that is tried."""
    scales = [scale]
    while scales[-1] > SLOWEST:
        scales.append(max(step * scales[-1], SLOWEST))
    return scales
