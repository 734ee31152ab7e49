"""Safe entry at run time: follows a plan, and makes another when the object is somewhere else."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from poil_drake.control.entry.entry_state import EntryMonitorConfig, EntryState, EntryStatus
from poil_drake.control.entry.safe_entry import EntryKind, SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import BcsdmStatus, point_set_bcsdm
from poil_drake.errors import PlanningError
from poil_drake.geometry.frozen_array import frozen_array

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
    keeps the plan. Where no way is found it goes on trying. Points that do not determine a motion
    leave everything as it is, but for the output, which says LOST unless the object is to stand
    still anyway.

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
        return _planned(state, now) if _attempt_is_due(state, now) else state
    state = _followed(state, now)
    if state.output is None or state.output.status is not BcsdmStatus.OK:
        return state
    if state.plan is not None and state.plan.kind is EntryKind.OFF:
        failed = state.status is EntryStatus.FAILED
        due = failed and time - state.attempt_time >= config.failed_period
        return _planned(state, now) if due and _is_blocked(state, now) else state
    on_way = math.isinf(state.off_since)
    if on_way and state.recoveries < config.max_recoveries and _is_blocked(state, now):
        recovering = replace(state, recoveries=state.recoveries + 1)
        return _planned(recovering, now, avoid_field=True)
    if time >= state.next_check or state.output.mean_error > state.checked_error + config.jump:
        state = _checked(state, now)
    if math.isinf(state.off_since):
        return state
    if time - state.off_since >= config.patience_after(state.returns):
        return _planned(replace(state, returns=state.returns + 1), now)
    return replace(state, status=EntryStatus.HOLDING, output=None)


class _Now(NamedTuple):
    """What is there besides the state."""

    points: np.ndarray
    confidence: np.ndarray | None
    time: float
    planner: SafeEntryPlanner
    config: EntryMonitorConfig


def _attempt_is_due(state: EntryState, now: _Now) -> bool:
    """Returns whether to plan, where there is no plan."""
    waited = now.time - state.attempt_time
    if state.status is EntryStatus.FAILED and not _have_moved(state, now):
        return waited >= now.config.failed_period
    return waited >= now.config.retry_period


def _have_moved(state: EntryState, now: _Now) -> bool:
    """Returns whether the points are somewhere else than at the last attempt."""
    if state.attempt_points is None:
        return False
    moved = np.linalg.norm(now.points - state.attempt_points, axis=1)
    moved = moved[np.isfinite(moved)]
    return moved.size > 0 and bool(np.median(moved) > now.config.jump)


def _followed(state: EntryState, now: _Now) -> EntryState:
    """Returns the state with the field at the points, and what it says of progress."""
    assert state.plan is not None
    output = point_set_bcsdm(
        now.points, state.plan.reference, state.plan.field, now.confidence, state.tau
    )
    if output.status is BcsdmStatus.LOST:
        kept = None if state.output is None else output
        return replace(state, output=kept, lost_since=min(state.lost_since, now.time))
    best_tau, best_error, progress_time = state.best_tau, state.best_error, state.progress_time
    progress_time += max(now.time - state.lost_since, 0.0)
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
        lost_since=math.inf,
        best_tau=best_tau,
        best_error=best_error,
        progress_time=progress_time,
    )


def _is_blocked(state: EntryState, now: _Now) -> bool:
    """Returns whether nothing has got better for long, and the object is not about to arrive."""
    assert state.plan is not None and state.output is not None  # noqa: PT018
    left = state.plan.reference.times[-1] - state.tau
    arriving = left <= state.plan.field.goal_window
    there = arriving and state.output.mean_error <= now.config.stall_error
    return not there and now.time - state.progress_time >= now.config.stall_time


def _checked(state: EntryState, now: _Now) -> EntryState:
    """Returns the state with what is known of whether the object is on its way."""
    assert state.plan is not None and state.output is not None  # noqa: PT018
    plan = now.planner.check(state.plan, now.points, state.tau, now.confidence)
    off_since, progress_time = min(state.off_since, now.time), state.progress_time
    if plan is not None:
        progress_time = min(progress_time + now.time - off_since, now.time)
        off_since = math.inf
    return replace(
        state,
        plan=state.plan if plan is None else plan,
        off_since=off_since,
        progress_time=progress_time,
        checked_error=state.output.mean_error,
        next_check=now.time + now.config.check_period,
    )


def _planned(state: EntryState, now: _Now, *, avoid_field: bool = False) -> EntryState:
    """Returns the state after an attempt to plan from where the points are."""
    reference, field = now.planner.model.reference, now.planner.field
    output = point_set_bcsdm(now.points, reference, field, now.confidence)
    if output.status is BcsdmStatus.LOST:
        return _without_points(state)
    seed = now.config.seed + state.replans + state.recoveries + state.attempts
    try:
        plan = now.planner.plan(now.points, now.confidence, seed=seed, avoid_field=avoid_field)
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
        returns=state.returns,
    )
    begun = _followed(begun, now)
    return _without_points(state) if begun.output is None else begun


def _without_points(state: EntryState) -> EntryState:
    """Returns the state after points that are too few, or too narrow, to plan from."""
    if state.plan is None or state.plan.kind is EntryKind.OFF:
        return state
    return replace(state, status=EntryStatus.HOLDING, output=None)


def _without_way(state: EntryState, now: _Now) -> EntryState:
    """Returns the state after an attempt that found no way."""
    attempts = state.attempts + 1
    failed = attempts >= now.config.max_attempts
    points = frozen_array(
        now.points, name="EntryState.attempt_points", shape=("N", 3), finite=False
    )
    falling_back = failed and now.config.fallback == "field"
    if falling_back and state.status is EntryStatus.FAILED:
        return replace(state, attempts=attempts, attempt_time=now.time, attempt_points=points)
    waiting = EntryState(
        status=EntryStatus.FAILED if failed else EntryStatus.HOLDING,
        attempts=attempts,
        attempt_time=now.time,
        attempt_points=points,
        replans=state.replans,
        recoveries=state.recoveries,
        returns=state.returns,
    )
    if not falling_back:
        return waiting
    begun = replace(waiting, plan=now.planner.unguarded(), progress_time=now.time)
    return _followed(begun, now)
