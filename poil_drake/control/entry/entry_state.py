"""State and parameters of safe entry at run time."""

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
    """Status of safe entry."""

    WAITING = 0  # Too few points have been observed to plan.
    FOLLOWING = 1  # The points are on a plan.
    HOLDING = 2  # The object is off its path, or no path was found: it should stand still.
    FAILED = 3  # Repeated attempts found no path. See `EntryMonitorConfig.fallback`.


@dataclass(frozen=True, kw_only=True)
class EntryMonitorConfig:
    """When safe entry plans again.

    Attributes:
        jump: An increase of the points' mean distance from the reference by this much triggers an
            immediate check [m]; three times a tracker's noise. After planning has failed, a motion
            of the points by this much triggers another attempt [m, median].
        patience: Time for which the object must be off its path, standing still, before it gets
            another plan [s]. One bad frame of a tracker is not enough.
        patience_step: Increase of the patience after each of these plans [s], so that persistent
            tracking errors do not trigger plans forever.
        max_patience: Longest patience [s].
        stall_time: The object is blocked if it makes no progress for this time [s]. Time in which
            it should stand still, or in which the points are lost, does not count.
        stall_error: Within this distance of the reference's end the object has arrived, and is not
            blocked [m, mean].
        max_recoveries: Largest number of new plans for a blocked object. The scene's cloud does not
            contain the obstacle, so more plans do not help.
        retry_period: Time between attempts to plan if no path was found [s].
        max_attempts: Number of successive attempts without a path after which planning has failed.
        failed_period: Time between attempts after planning has failed, unless the points have moved
            by `jump` [s]. An attempt that fails takes a few seconds of processor time.
        fallback: Behaviour after planning has failed. "hold" stands still. "field" follows the
            paper's field, which converges from almost everywhere but ignores obstacles, and plans
            again only if the object is blocked.
    """

    jump: float = 0.01
    patience: float = 0.1
    patience_step: float = 0.2
    max_patience: float = 2.0
    stall_time: float = 2.0
    stall_error: float = 0.006
    max_recoveries: int = 3
    retry_period: float = 0.5
    max_attempts: int = 4
    failed_period: float = 10.0
    fallback: Literal["hold", "field"] = "hold"

    def __post_init__(self) -> None:
        if not (0.0 <= self.patience <= self.max_patience and self.patience_step >= 0.0):
            raise InvalidValueError(
                f"EntryMonitorConfig has a patience of {self.patience} s, a patience_step of "
                f"{self.patience_step} s and a max_patience of {self.max_patience} s.",
                remedy="Pass 0 <= patience <= max_patience and a non-negative patience_step.",
            )

    def patience_after(self, returns: int) -> float:
        """Returns the patience [s] after `returns` attempts to plan for an object off its path."""
        return min(self.patience + returns * self.patience_step, self.max_patience)


@dataclass(frozen=True, eq=False)
class EntryState(SharedOnCopy):
    """State between two steps.

    Attributes:
        status: The status.
        plan: The plan being followed; None without one.
        output: The field on the plan's reference at the last points. None if the object should
            stand still, because it has no plan or is off its path.
        tau: The last finite time of the closest configuration on the plan's reference [s].
        checked_error: Least mean error since the last check of whether the object is on its path
            [m].
        next_check: Time of the next of these checks [s].
        off_since: Time when the object was found off its path [s]; infinite while it is on the
            path.
        lost_since: Time when the points were lost [s]; infinite while they are observed.
        best_tau: Largest tau on this plan [s].
        best_error: Least mean error on this plan [m].
        progress_time: Time of the last progress [s], plus the time that is not counted as a stall.
        attempts: Number of successive attempts that found no path.
        attempt_time: Time of the last of these attempts [s].
        attempt_points: (N, 3) the points at that time [m, world]; None if there was no attempt.
        replans: Number of plans, including the first.
        recoveries: Number of attempts to plan because the object was blocked.
        returns: Number of attempts to plan because the object was off its path.
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
        """The reference to follow now; None if the object should stand still."""
        return None if self.output is None or self.plan is None else self.plan.reference
