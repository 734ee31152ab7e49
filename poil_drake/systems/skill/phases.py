"""The phases of the skill and the pure function that moves from one to the next."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np


class Phase(IntEnum):
    """What the robot is doing."""

    WAIT = 0
    APPROACH = 1
    DESCEND = 2
    GRASP = 3
    LIFT = 4
    FOLLOW = 5
    RELEASE = 6
    RETREAT = 7
    SETTLE = 8
    DONE = 9
    FAULT = 10


class Fault(IntEnum):
    """Why the skill was given up."""

    NONE = 0
    TRACKING_LOST = 1
    GRASP_MISSED = 2
    OBJECT_DROPPED = 3
    NO_PROGRESS = 4
    IK_STUCK = 5
    HAND_STATUS = 6
    TIMEOUT = 7
    SAFETY = 8
    HAND_IDLE = 9


FAULT_TEXT = {
    Fault.NONE: "no fault",
    Fault.TRACKING_LOST: "the tracker lost the object and did not find it again",
    Fault.GRASP_MISSED: "the fingers closed on nothing",
    Fault.OBJECT_DROPPED: "the object slipped out of the fingers",
    Fault.NO_PROGRESS: "the points stopped short of the reference",
    Fault.IK_STUCK: "the arm could not follow the asked twist (joint limit or singularity)",
    Fault.HAND_STATUS: "the hand stopped reporting its opening",
    Fault.TIMEOUT: "a phase took longer than allowed",
    Fault.SAFETY: "the safety supervisor stopped the arm",
    Fault.HAND_IDLE: "the hand did not close when it was told to",
}
"""One readable clause for each fault."""


@dataclass(frozen=True, kw_only=True)
class SkillConfig:
    """Thresholds and times of the skill.

    Attributes:
        pregrasp_width: Finger opening while approaching [m].
        release_width: Finger opening after the goal [m]; less than fully open where a finger
            stands inside the object.
        closed_width: An opening below this means that nothing is between the fingers [m].
        grasp_settle_time: How long the fingers must stand still to call the object grasped [s].
        hand_delay: How long it may take until a command to the hand shows in its opening [s];
            fingers that stand still before that have not begun to close.
        finger_still_speed: Finger speed that counts as standing still [m/s].
        release_time: Time given to the fingers to open and the object to come to rest [s].
        settle_time: Time watched after the retreat [s].
        goal_hold_time: How long the goal must hold before release [s].
        goal_patience: Without progress for this long, a residual below `accepted_error` is
            released and a larger one is a fault [s].
        accepted_error: Largest mean distance from the reference's end that may be released [m].
        progress_step: A decrease of the error, or an advance along the reference, that counts as
            progress [m, s].
        lost_grace: How long the points may be lost before the part is searched anew [s]; while
            the robot waits for the first track, it is searched as often.
        lost_fault: How long the points may be lost before giving up [s].
        stuck_time: How long the inverse kinematics may be stuck [s].
        phase_time_limit: No phase may take longer [s].
    """

    pregrasp_width: float = 0.08
    release_width: float = 0.08
    closed_width: float = 0.001
    grasp_settle_time: float = 0.25
    hand_delay: float = 0.0
    finger_still_speed: float = 0.002
    release_time: float = 0.75
    settle_time: float = 2.5
    goal_hold_time: float = 0.25
    goal_patience: float = 2.0
    accepted_error: float = 0.010
    progress_step: float = 0.0005
    lost_grace: float = 0.75
    lost_fault: float = 3.0
    stuck_time: float = 2.0
    phase_time_limit: float = 40.0


class Observation(NamedTuple):
    """What the sequencer sees at one control tick.

    Attributes:
        time: Now [s].
        tracking: Whether the tracker follows the object.
        at_goal: Whether the controller reports the goal.
        points_lost: Whether the controller lacks enough points.
        tau: Progress along the reference [s].
        mean_error: Mean distance of the points to the current target [m].
        goal_error: Mean distance of the points to the reference's end [m].
        motion_done: Whether the commanded joint or straight motion has ended.
        ik_stuck: Whether the inverse kinematics cannot follow.
        hand_width: Measured finger opening [m]; NaN where it is not known.
        safe: Whether the safety supervisor lets the arm move.
    """

    time: float
    tracking: bool
    at_goal: bool
    points_lost: bool
    tau: float
    mean_error: float
    goal_error: float
    motion_done: bool
    ik_stuck: bool
    hand_width: float
    safe: bool


class SkillState(NamedTuple):
    """The sequencer's memory; all floats, so that it fits a discrete state vector.

    Attributes:
        phase: The current `Phase`.
        phase_start: When it began [s].
        fault: The `Fault`, once the phase is FAULT.
        last_width: Finger opening at the last tick [m]; NaN before the first.
        last_time: Time of the last tick [s].
        still_since: Since when the fingers stand still [s]; NaN while they move.
        goal_since: Since when the goal holds [s]; NaN when it does not.
        lost_since: Since when the points are lost [s]; NaN when they are not.
        stuck_since: Since when the inverse kinematics is stuck [s]; NaN when it is not.
        best_error: Smallest error since the last progress [m].
        best_tau: Largest progress along the reference [s].
        progress_at: When progress was last made [s].
        detect_requests: How often the part detector was asked to look again.
        asked: 1 once it was asked about the present loss.
        fault_width: Finger opening [m] that was commanded when the fault came, which stays.
    """

    phase: float = float(Phase.WAIT)
    phase_start: float = 0.0
    fault: float = float(Fault.NONE)
    last_width: float = np.nan
    last_time: float = 0.0
    still_since: float = np.nan
    goal_since: float = np.nan
    lost_since: float = np.nan
    stuck_since: float = np.nan
    best_error: float = np.inf
    best_tau: float = -np.inf
    progress_at: float = 0.0
    detect_requests: float = 0.0
    asked: float = 0.0
    fault_width: float = np.nan


HOLDING = frozenset({Phase.LIFT, Phase.FOLLOW})
"""Phases in which the object moves with the gripper."""

_OPEN_BEFORE = frozenset({Phase.WAIT, Phase.APPROACH, Phase.DESCEND})
_OPEN_AFTER = frozenset({Phase.RELEASE, Phase.RETREAT, Phase.SETTLE, Phase.DONE})
_TWIST_PHASES = frozenset({Phase.LIFT, Phase.FOLLOW, Phase.RETREAT})
# Looking a member up in its class takes longer than all the rest of a comparison.
_WAIT, _GRASP, _FOLLOW, _NO_FAULT = Phase.WAIT, Phase.GRASP, Phase.FOLLOW, Fault.NONE
_HARDLY_CLOSED = 0.0005
"""A hand that is to grip and closed by less [m] did not close."""

_ENDED = frozenset({Phase.DONE, Phase.FAULT})


def next_state(state: SkillState, seen: Observation, config: SkillConfig) -> SkillState:
    """Returns the sequencer's memory after one control tick.

    Args:
        state: The memory before.
        seen: What is observed now.
        config: Thresholds and times.
    """
    if Phase(int(state.phase)) in _ENDED:
        return state
    state = _remember(state, seen, config)
    fault = _fault(state, seen, config)
    if fault is not _NO_FAULT:
        return state._replace(
            phase=float(Phase.FAULT),
            phase_start=seen.time,
            fault=float(fault),
            fault_width=hand_width_of(Phase(int(state.phase)), config),
        )
    following = _following_phase(state, seen, config)
    if following is None:
        return state
    return state._replace(
        phase=float(following),
        phase_start=seen.time,
        still_since=np.nan,
        goal_since=np.nan,
        stuck_since=np.nan,
        best_error=np.inf,
        best_tau=-np.inf,
        progress_at=seen.time,
    )


def _since(flag: bool, since: float, now: float) -> float:
    if not flag:
        return math.nan
    return now if math.isnan(since) else since


def _lasted(since: float, now: float, duration: float) -> bool:
    return not math.isnan(since) and now - since >= duration


def _remember(state: SkillState, seen: Observation, config: SkillConfig) -> SkillState:
    phase = Phase(int(state.phase))
    elapsed = seen.time - state.last_time
    still = (
        elapsed > 0.0
        and abs(seen.hand_width - state.last_width) <= config.finger_still_speed * elapsed
    )
    watching = phase is _FOLLOW
    waiting = phase is _WAIT and not seen.tracking
    lost = waiting or (watching and (seen.points_lost or not seen.tracking))
    lost_since = _since(lost, state.lost_since, seen.time)
    ask = not state.asked and _lasted(lost_since, seen.time, config.lost_grace)
    # Nothing hurries while the robot rests: what hides the part may go away.
    again = waiting and ask
    progressed = seen.mean_error < state.best_error - config.progress_step or (
        seen.tau > state.best_tau + config.progress_step
    )
    return state._replace(
        last_width=seen.hand_width,
        last_time=seen.time,
        still_since=_since(still and phase is _GRASP, state.still_since, seen.time),
        goal_since=_since(watching and seen.at_goal, state.goal_since, seen.time),
        lost_since=seen.time if again else lost_since,
        stuck_since=_since(seen.ik_stuck and phase in _TWIST_PHASES, state.stuck_since, seen.time),
        best_error=seen.mean_error if progressed else state.best_error,
        best_tau=max(seen.tau, state.best_tau),
        progress_at=seen.time if progressed or not watching or lost else state.progress_at,
        detect_requests=state.detect_requests + ask,
        asked=float(lost and not again and (ask or state.asked)),
    )


def _fault(state: SkillState, seen: Observation, config: SkillConfig) -> Fault:
    phase = Phase(int(state.phase))
    if not seen.safe:
        return Fault.SAFETY
    if math.isnan(seen.hand_width):
        return Fault.HAND_STATUS
    if _lasted(state.lost_since, seen.time, config.lost_fault):
        return Fault.TRACKING_LOST
    if _lasted(state.stuck_since, seen.time, config.stuck_time):
        return Fault.IK_STUCK
    if phase in HOLDING and seen.hand_width < config.closed_width:
        return Fault.OBJECT_DROPPED
    if phase is _GRASP and seen.hand_width < config.closed_width:
        return Fault.GRASP_MISSED
    idle = seen.hand_width >= config.pregrasp_width - _HARDLY_CLOSED
    if phase is _GRASP and idle and _ENDS[phase](state, seen, config):
        return Fault.HAND_IDLE
    stalled = _stalled(state, seen, config)
    if phase is _FOLLOW and stalled and not seen.goal_error <= config.accepted_error:
        return Fault.NO_PROGRESS
    if seen.time - state.phase_start > config.phase_time_limit:
        return Fault.TIMEOUT
    return _NO_FAULT


def _following_phase(state: SkillState, seen: Observation, config: SkillConfig) -> Phase | None:
    """Returns the phase that begins now, or None to stay."""
    phase = Phase(int(state.phase))
    return Phase(phase + 1) if _ENDS[phase](state, seen, config) else None


def _stalled(state: SkillState, seen: Observation, config: SkillConfig) -> bool:
    return seen.time - state.progress_at > config.goal_patience


def _motion_ended(state: SkillState, seen: Observation, config: SkillConfig) -> bool:
    return seen.motion_done


_ENDS: dict[Phase, Callable[[SkillState, Observation, SkillConfig], bool]] = {
    Phase.WAIT: lambda state, seen, config: seen.tracking,
    Phase.APPROACH: _motion_ended,
    Phase.DESCEND: _motion_ended,
    Phase.GRASP: lambda state, seen, config: (
        seen.time - state.phase_start >= config.hand_delay + config.grasp_settle_time
        and _lasted(state.still_since, seen.time, config.grasp_settle_time)
    ),
    Phase.LIFT: _motion_ended,
    Phase.FOLLOW: lambda state, seen, config: (
        _lasted(state.goal_since, seen.time, config.goal_hold_time)
        or (_stalled(state, seen, config) and seen.goal_error <= config.accepted_error)
    ),
    Phase.RELEASE: lambda state, seen, config: (
        seen.time - state.phase_start >= config.hand_delay + config.release_time
    ),
    Phase.RETREAT: _motion_ended,
    Phase.SETTLE: lambda state, seen, config: seen.time - state.phase_start >= config.settle_time,
}
"""When each phase ends."""


def hand_width_of(phase: Phase, config: SkillConfig) -> float:
    """Returns the finger opening [m] to command in a phase other than FAULT."""
    if phase in _OPEN_BEFORE:
        return config.pregrasp_width
    if phase in _OPEN_AFTER:
        return config.release_width
    return 0.0
