"""Safe entry at run time: follows a plan, and makes another when the object is somewhere else."""

import enum
import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from poil_drake.control.point_set_bcsdm import BcsdmOutput, BcsdmStatus, point_set_bcsdm
from poil_drake.control.point_trajectory import PointTrajectory
from poil_drake.control.safe_entry import EntryKind, EntryPlan, SafeEntryPlanner
from poil_drake.errors import PlanningError, TrackingError
from poil_drake.geometry.frozen_array import SharedOnCopy


class EntryStatus(enum.IntEnum):
    """What safe entry is doing."""

    WAITING = 0  # Too few points have been observed so far to plan.
    FOLLOWING = 1  # There is a plan, and the points are on it.
    HOLDING = 2  # The object is off its way, or no way was found: it should stand still.
    FAILED = 3  # No way was found in all attempts. See `EntryMonitorConfig.fallback`.


@dataclass(frozen=True, kw_only=True)
class EntryMonitorConfig:
    """When another plan is made.

    Attributes:
        check_period: Time between two looks whether the object is on the way planned [s].
        jump: The points getting this much farther from the reference asks for a look at once [m,
            mean]; three times a tracker's noise.
        patience: How long the object must be off its way, standing still, before there is another
            plan [s]: one bad frame of a tracker is no reason.
        stall_time: Without progress for this long the object is blocked [s].
        stall_error: Nearer than this to the reference's end it is not blocked but there [m, mean].
        stall_advance: What counts as progress: this much of tau [s] ...
        stall_gain: ... or of the mean error [m].
        max_recoveries: How often a blocked object gets another plan. What blocks it is not in the
            scene's cloud, so plans do not help forever.
        retry_period: Time between attempts to plan where there was no way [s].
        max_attempts: After as many attempts in a row that found no way, planning has failed.
        fallback: What to do then: "hold" stands still; "field" follows the paper's field, which
            converges from almost everywhere but knows no obstacles.
        seed: Of the searches.
    """

    check_period: float = 1.0 / 16.0
    jump: float = 0.01
    patience: float = 0.1
    stall_time: float = 2.0
    stall_error: float = 0.006
    stall_advance: float = 0.05
    stall_gain: float = 0.005
    max_recoveries: int = 3
    retry_period: float = 0.5
    max_attempts: int = 4
    fallback: Literal["hold", "field"] = "hold"
    seed: int = 0


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
        best_tau: Farthest tau on this plan [s].
        best_error: Least mean error on this plan [m].
        progress_time: When one of both last got better [s].
        attempts: Attempts in a row that found no way.
        next_attempt: When to plan again [s].
        replans: Plans made, the first included.
        recoveries: Those made because the object was blocked.
    """

    status: EntryStatus = EntryStatus.WAITING
    plan: EntryPlan | None = None
    output: BcsdmOutput | None = None
    tau: float = math.nan
    checked_error: float = math.inf
    next_check: float = -math.inf
    off_since: float = math.inf
    best_tau: float = -math.inf
    best_error: float = math.inf
    progress_time: float = -math.inf
    attempts: int = 0
    next_attempt: float = -math.inf
    replans: int = 0
    recoveries: int = 0

    @property
    def reference(self) -> PointTrajectory | None:
        """What to follow now; None where the object should stand still."""
        return None if self.output is None or self.plan is None else self.plan.reference


_DEFAULTS = EntryMonitorConfig()


def safe_entry_step(
    state: EntryState,
    points: np.ndarray,
    time: float,
    planner: SafeEntryPlanner,
    config: EntryMonitorConfig = _DEFAULTS,
    confidence: np.ndarray | None = None,
) -> EntryState:
    """Returns what to follow now; its `output` is the field at the points, None to stand still.

    It plans at the first call with three points; when the object has been off the way planned for
    longer than the patience, during which it stands still; and when it is blocked. Otherwise it
    keeps the plan.

    Args:
        state: Of the step before; `EntryState()` at first. It stays as it was.
        points: (N, 3) where the points are [m, world]; NaN where not observed.
        time: Now [s].
        planner: What plans, and the field.
        config: When to plan.
        confidence: (N,) weights in [0, 1]; None for all equal.
    """
    now = _Now(points, confidence, time, planner, config)
    if state.plan is None:
        if time < state.next_attempt or state.status is EntryStatus.FAILED:
            return state
        return _planned(state, now, avoid_field=False)
    state = _followed(state, now)
    if state.plan is None or state.output is None or state.plan.kind is EntryKind.OFF:
        return state
    if state.output.status is not BcsdmStatus.OK:
        return state
    if _is_blocked(state, now) and state.recoveries < config.max_recoveries:
        recovering = replace(state, recoveries=state.recoveries + 1)
        return _planned(recovering, now, avoid_field=True)
    if time >= state.next_check or state.output.mean_error > state.checked_error + config.jump:
        state = _checked(state, now)
    if time - state.off_since >= config.patience:
        return _planned(state, now, avoid_field=False)
    if math.isinf(state.off_since):
        return state
    return replace(state, status=EntryStatus.HOLDING, output=None)


class _Now(NamedTuple):
    """What is there besides the state."""

    points: np.ndarray
    confidence: np.ndarray | None
    time: float
    planner: SafeEntryPlanner
    config: EntryMonitorConfig


def _followed(state: EntryState, now: _Now) -> EntryState:
    """Returns the state with the field at the points, and what it says of progress."""
    assert state.plan is not None
    output = point_set_bcsdm(
        now.points, state.plan.reference, now.planner.field, now.confidence, state.tau
    )
    if output.status is BcsdmStatus.LOST:
        return replace(state, output=output)
    best_tau, best_error, progress_time = state.best_tau, state.best_error, state.progress_time
    if output.tau >= best_tau + now.config.stall_advance:
        best_tau, progress_time = output.tau, now.time
    if output.mean_error <= best_error - now.config.stall_gain:
        best_error, progress_time = output.mean_error, now.time
    failed = state.status is EntryStatus.FAILED
    return replace(
        state,
        status=EntryStatus.FAILED if failed else EntryStatus.FOLLOWING,
        output=output,
        tau=output.tau,
        checked_error=min(state.checked_error, output.mean_error),
        best_tau=best_tau,
        best_error=best_error,
        progress_time=progress_time,
    )


def _is_blocked(state: EntryState, now: _Now) -> bool:
    """Returns whether nothing has got better for long, and the object is not about to arrive."""
    assert state.plan is not None and state.output is not None  # noqa: PT018
    left = state.plan.reference.times[-1] - state.tau
    arriving = left <= now.planner.field.goal_window
    there = arriving and state.output.mean_error <= now.config.stall_error
    return not there and now.time - state.progress_time >= now.config.stall_time


def _checked(state: EntryState, now: _Now) -> EntryState:
    """Returns the state with what is known of whether the object is on its way."""
    assert state.plan is not None and state.output is not None  # noqa: PT018
    plan = now.planner.check(state.plan, now.points, state.tau, now.confidence)
    return replace(
        state,
        plan=state.plan if plan is None else plan,
        off_since=math.inf if plan is not None else min(state.off_since, now.time),
        checked_error=state.output.mean_error,
        next_check=now.time + now.config.check_period,
    )


def _planned(state: EntryState, now: _Now, *, avoid_field: bool) -> EntryState:
    seed = now.config.seed + state.replans + state.attempts
    try:
        plan = now.planner.plan(now.points, now.confidence, seed=seed, avoid_field=avoid_field)
    except TrackingError:
        return replace(state, output=None)
    except PlanningError:
        if avoid_field:
            # What was followed is still the best that is known.
            return replace(state, progress_time=now.time)
        return _without_way(state, now)
    begun = EntryState(
        status=EntryStatus.FOLLOWING,
        plan=plan,
        progress_time=now.time,
        next_check=now.time + now.config.check_period,
        replans=state.replans + 1,
        recoveries=state.recoveries,
    )
    return _followed(begun, now)


def _without_way(state: EntryState, now: _Now) -> EntryState:
    """Returns the state after an attempt that found no way."""
    attempts = state.attempts + 1
    failed = attempts >= now.config.max_attempts
    waiting = EntryState(
        status=EntryStatus.FAILED if failed else EntryStatus.HOLDING,
        attempts=attempts,
        next_attempt=now.time + now.config.retry_period,
        replans=state.replans,
        recoveries=state.recoveries,
    )
    if failed and now.config.fallback == "field":
        return _followed(replace(waiting, plan=now.planner.unguarded()), now)
    return waiting
