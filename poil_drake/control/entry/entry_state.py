"""What safe entry remembers at run time, and when it plans again."""

import enum
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from poil_drake.control.entry.safe_entry import EntryPlan
from poil_drake.control.field.point_set_bcsdm import BcsdmOutput
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy


class EntryStatus(enum.IntEnum):
    """What safe entry is doing."""

    WAITING = 0  # Too few points have been observed so far to plan.
    FOLLOWING = 1  # There is a plan, and the points are on it.
    HOLDING = 2  # The object is off its way, or no way was found: it should stand still.
    FAILED = 3  # Many attempts found no way; there are more. See `EntryMonitorConfig.fallback`.


@dataclass(frozen=True, kw_only=True)
class EntryMonitorConfig:
    """When another plan is made.

    Attributes:
        check_period: Time between two looks whether the object is on the way planned [s].
        jump: The points getting this much farther from the reference asks for a look at once [m,
            mean]; three times a tracker's noise. Where planning has failed, a motion by this much
            asks for another attempt [m, median].
        patience: How long the object must be off its way, standing still, before there is another
            plan [s]: one bad frame of a tracker is no reason.
        patience_step: After every such plan the patience is this much longer [s], so that a track
            which is bad for longer than the first patience does not make plans for ever ...
        max_patience: ... but it is never longer than this [s].
        stall_time: Without progress for this long the object is blocked [s]. Time in which it was
            to stand still, or in which there were no points, does not count.
        stall_error: Nearer than this to the reference's end it is not blocked but there [m, mean].
        stall_advance: What counts as progress: this much of tau [s] ...
        stall_gain: ... or of the mean error [m].
        max_recoveries: How often a blocked object gets another plan. What blocks it is not in the
            scene's cloud, so plans do not help forever.
        retry_period: Time between attempts to plan where there was no way [s].
        max_attempts: After as many attempts in a row that found no way, planning has failed ...
        failed_period: ... and attempts are this far apart [s], unless the points have moved by
            `jump` since the last. One that fails takes a few seconds of the processor.
        fallback: What to do then: "hold" stands still; "field" follows the paper's field, which
            converges from almost everywhere but knows no obstacles, and tries to plan again only
            where that is blocked.
        seed: Of the searches.
    """

    check_period: float = 1.0 / 16.0
    jump: float = 0.01
    patience: float = 0.1
    patience_step: float = 0.2
    max_patience: float = 2.0
    stall_time: float = 2.0
    stall_error: float = 0.006
    stall_advance: float = 0.05
    stall_gain: float = 0.005
    max_recoveries: int = 3
    retry_period: float = 0.5
    max_attempts: int = 4
    failed_period: float = 10.0
    fallback: Literal["hold", "field"] = "hold"
    seed: int = 0

    def __post_init__(self) -> None:
        if not (0.0 <= self.patience <= self.max_patience and self.patience_step >= 0.0):
            raise InvalidValueError(
                f"EntryMonitorConfig has patience={self.patience} s, "
                f"patience_step={self.patience_step} s and max_patience={self.max_patience} s.",
                remedy="Let the patience grow, or stay, up to a larger one.",
            )

    def patience_after(self, returns: int) -> float:
        """Returns the patience after so many plans of an object that was off its way [s]."""
        return min(self.patience + returns * self.patience_step, self.max_patience)


@dataclass(frozen=True, eq=False)
class EntryState(SharedOnCopy):
    """What is remembered between two steps.

    Attributes:
        status: What is being done.
        plan: What is followed; None where there is none.
        output: The field on the plan's reference at the last points. None where the object should
            stand still, for want of a plan or because it is off its way.
        tau: The last finite time of the closest configuration, in the plan's time base [s].
        checked_error: Least mean error since it was seen whether the object is on its way [m].
        next_check: When to see that again [s].
        off_since: When the object was found off its way [s]; infinite while it is on it.
        lost_since: When the points were lost [s]; infinite while they are seen.
        best_tau: Farthest tau on this plan [s].
        best_error: Least mean error on this plan [m].
        progress_time: When one of both last got better [s], later by the time that does not count.
        attempts: Attempts in a row that found no way.
        attempt_time: When the last of them was [s].
        attempt_points: (N, 3) where the points were then [m, world]; None before the first.
        replans: Plans made, the first included.
        recoveries: How often one was to be made because the object was blocked.
        returns: How often because it was off its way.
    """

    status: EntryStatus = EntryStatus.WAITING
    plan: EntryPlan | None = None
    output: BcsdmOutput | None = None
    tau: float = math.nan
    checked_error: float = math.inf
    next_check: float = -math.inf
    off_since: float = math.inf
    lost_since: float = math.inf
    best_tau: float = -math.inf
    best_error: float = math.inf
    progress_time: float = -math.inf
    attempts: int = 0
    attempt_time: float = -math.inf
    attempt_points: np.ndarray | None = None
    replans: int = 0
    recoveries: int = 0
    returns: int = 0

    @property
    def reference(self) -> PointTrajectory | None:
        """What to follow now; None where the object should stand still."""
        return None if self.output is None or self.plan is None else self.plan.reference
