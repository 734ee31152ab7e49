"""Safe entry at run time: follows a plan, and plans again when the object leaves it."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from poil_drake.control.entry.entry_state import EntryMonitorConfig, EntryState, EntryStatus
from poil_drake.control.entry.safe_entry import EntryKind, SafeEntryPlanner
from poil_drake.control.field.point_set_bcsdm import BcsdmStatus, point_set_bcsdm
from poil_drake.errors import PlanningError

_DEFAULTS = EntryMonitorConfig()

_CHECK_PERIOD = 1.0 / 16.0
"""Time between two checks of whether the object is on its path [s]."""

_PROGRESS_ADVANCE, _PROGRESS_GAIN = 0.05, 0.005
"""Progress is an increase of `EntryState.tau` by this [s], or a decrease of the mean error [m]."""


def safe_entry_step(
    state: EntryState,
    points: np.ndarray,
    time: float,
    planner: SafeEntryPlanner,
    config: EntryMonitorConfig = _DEFAULTS,
    confidence: np.ndarray | None = None,
) -> EntryState:
    """Returns the next state; its `output` is the field at the points, None to stand still.

    A step plans when three points are first observed, when the object is blocked, and when it has
    been off its path, standing still, for longer than the patience. Other steps keep the plan. If
    no path is found, later steps try again. Points that do not determine a motion do not change the
    plan; the output is then LOST, or still None if the object is standing still.

    Args:
        state: The result of the last step, which is not modified; `EntryState()` at first.
        points: (N, 3) [m, world]; NaN where not observed.
        time: The present time [s].
        planner: The planner, which also provides the field.
        config: When to plan again.
        confidence: (N,) weights in [0, 1]; None for all equal.
    """
    now = _Inputs(points, confidence, time, planner, config)
    if state.plan is None:
        return _planned(state, now) if _attempt_is_due(state, now) else state
    state = _followed(state, now)
    if state.output is None or state.output.status is not BcsdmStatus.OK:
        return state
    if state.plan is not None and state.plan.kind is EntryKind.OFF:
        failed = state.status is EntryStatus.FAILED
        due = failed and time - state.attempt_time >= config.failed_period
        return _planned(state, now) if due and _is_blocked(state, now) else state
    on_path = math.isinf(state.off_since)
    if on_path and state.recoveries < config.max_recoveries and _is_blocked(state, now):
        recovering = replace(state, recoveries=state.recoveries + 1)
        return _planned(recovering, now, avoid_field=True)
    if time >= state.next_check or state.output.mean_error > state.checked_error + config.jump:
        state = _checked(state, now)
    if math.isinf(state.off_since):
        return state
    if time - state.off_since >= config.patience_after(state.returns):
        return _planned(replace(state, returns=state.returns + 1), now)
    return replace(state, status=EntryStatus.HOLDING, output=None)


class _Inputs(NamedTuple):
    """The inputs of a step."""

    points: np.ndarray
    confidence: np.ndarray | None
    time: float
    planner: SafeEntryPlanner
    config: EntryMonitorConfig


def _attempt_is_due(state: EntryState, now: _Inputs) -> bool:
    """Returns whether the next attempt to plan is due in a state without a plan."""
    waited = now.time - state.attempt_time
    if state.status is EntryStatus.FAILED and not _have_moved(state, now):
        return waited >= now.config.failed_period
    return waited >= now.config.retry_period


def _have_moved(state: EntryState, now: _Inputs) -> bool:
    """Returns whether the points have moved by `jump` since the last attempt to plan."""
    if state.attempt_points is None:
        return False
    moved = np.linalg.norm(now.points - state.attempt_points, axis=1)
    moved = moved[np.isfinite(moved)]
    return moved.size > 0 and bool(np.median(moved) > now.config.jump)


def _followed(state: EntryState, now: _Inputs) -> EntryState:
    """Returns the state with the field at the new points and the progress along the plan."""
    assert state.plan is not None
    output = point_set_bcsdm(
        now.points, state.plan.reference, state.plan.field, now.confidence, state.tau
    )
    if output.status is BcsdmStatus.LOST:
        kept = None if state.output is None else output
        return replace(state, output=kept, lost_since=min(state.lost_since, now.time))
    best_tau, best_error, progress_time = state.best_tau, state.best_error, state.progress_time
    progress_time += max(now.time - state.lost_since, 0.0)
    if output.tau >= best_tau + _PROGRESS_ADVANCE:
        best_tau, progress_time = output.tau, now.time
    if output.mean_error <= best_error - _PROGRESS_GAIN:
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


def _is_blocked(state: EntryState, now: _Inputs) -> bool:
    """Returns whether the object has made no progress for too long without having arrived."""
    assert state.plan is not None and state.output is not None  # noqa: PT018
    left = state.plan.reference.times[-1] - state.tau
    near_end = left <= state.plan.field.goal_window
    arrived = near_end and state.output.mean_error <= now.config.stall_error
    return not arrived and now.time - state.progress_time >= now.config.stall_time


def _checked(state: EntryState, now: _Inputs) -> EntryState:
    """Returns the state after a check of whether the object is on its path."""
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
        next_check=now.time + _CHECK_PERIOD,
    )


def _planned(state: EntryState, now: _Inputs, *, avoid_field: bool = False) -> EntryState:
    """Returns the state after an attempt to plan from the points."""
    reference, field = now.planner.model.reference, now.planner.field
    output = point_set_bcsdm(now.points, reference, field, now.confidence)
    if output.status is BcsdmStatus.LOST:
        return _without_points(state)
    seed = state.replans + state.recoveries + state.attempts
    try:
        plan = now.planner.plan(now.points, now.confidence, seed=seed, avoid_field=avoid_field)
    except PlanningError:
        if avoid_field:
            # The present plan is still the best one known.
            return replace(state, progress_time=now.time)
        return _without_path(state, now)
    begun = EntryState(
        status=EntryStatus.FOLLOWING,
        plan=plan,
        progress_time=now.time,
        next_check=now.time + _CHECK_PERIOD,
        replans=state.replans + 1,
        recoveries=state.recoveries,
        returns=state.returns,
    )
    begun = _followed(begun, now)
    return _without_points(state) if begun.output is None else begun


def _without_points(state: EntryState) -> EntryState:
    """Returns the next state if the points do not determine a motion."""
    if state.plan is None or state.plan.kind is EntryKind.OFF:
        return state
    return replace(state, status=EntryStatus.HOLDING, output=None)


def _without_path(state: EntryState, now: _Inputs) -> EntryState:
    """Returns the state after an attempt to plan that found no path."""
    attempts = state.attempts + 1
    failed = attempts >= now.config.max_attempts
    points = now.points.copy()
    points.flags.writeable = False
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
