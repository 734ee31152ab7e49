"""The state machine of the skill: a pure function that steps from one phase to the next."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.robots.panda import MAX_HAND_WIDTH
from poil_drake.systems.skill.phases import HOLDING, TWIST_PHASES, Fault, Phase

_CLOSED_HAND = frozenset({Phase.GRASP, Phase.LIFT, Phase.FOLLOW})
_HARDLY_CLOSED = 0.0005
"""A hand commanded to grip counts as not closed if it closed by less than this [m]."""


@dataclass(frozen=True, kw_only=True)
class SkillConfig:
    """Thresholds and times of the skill.

    Attributes:
        open_width: Finger opening before the grasp and after the release [m]. Choose less than the
            hand's maximum if a finger grasps from inside the object.
        closed_width: An opening below this means that the fingers hold nothing [m].
        grasp_settle_time: How long the fingers must stand still around a grasped object [s].
        hand_delay: Longest time from a command until the hand's opening changes [s]. The times
            `grasp_settle_time` and `release_time` begin after it.
        finger_still_speed: Finger speed that counts as standing still [m/s].
        release_time: Time for the fingers to open and the object to come to rest [s].
        settle_time: Time in which the object is observed after the retreat [s].
        goal_hold_time: How long the points must stay at the goal before the release [s].
        goal_patience: How long the points may make no progress towards the goal [s]. After that,
            the hand releases the object if the points' mean distance from the goal is at most
            `accepted_error`; otherwise there is a fault.
        accepted_error: Largest mean distance of the points from the goal for such a release [m].
        progress_step: Smallest decrease of the mean error [m], or smallest advance along the
            reference [s], that counts as progress.
        lost_grace: How long the points may be lost before the part detector searches again [s].
            While the robot waits for the first track, the search is repeated at this period.
        lost_fault: How long the points may be lost before a fault [s].
        stuck_time: How long the inverse kinematics may be stuck before a fault [s].
        phase_time_limit: Longest duration of a phase [s].
    """

    open_width: float = MAX_HAND_WIDTH
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
    """The sequencer's observations in one control period.

    Attributes:
        time: Current time [s].
        tracking: Whether the tracker follows the object.
        at_goal: Whether the controller reports the goal.
        points_lost: Whether the controller has too few points.
        tau: Progress along the reference [s].
        mean_error: Mean distance of the points to the current target [m].
        goal_error: Mean distance of the points to the reference's end [m].
        motion_done: Whether the commanded joint or straight motion has ended.
        ik_stuck: Whether the inverse kinematics cannot follow the twist.
        hand_width: Measured finger opening [m]; NaN if unknown.
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
        phase_start: When the phase began [s].
        fault: The `Fault`, once the phase is FAULT.
        last_width: Finger opening in the last period [m]; NaN before the first.
        last_time: Time of the last period [s].
        still_since: When the fingers came to a standstill in GRASP [s]; NaN otherwise.
        goal_since: When the points reached the goal [s]; NaN while they are not there.
        lost_since: When the points were lost, or in WAIT when the last search began [s]; or NaN.
        stuck_since: When the inverse kinematics got stuck [s]; NaN while it is not stuck.
        best_error: The mean error at the last progress [m].
        best_tau: Largest progress along the reference [s].
        progress_at: Time of the last progress [s].
        detect_request: Number of requests to the part detector to search again.
        asked: 1 once the present loss of the points has led to a new search.
        width: Finger opening to command [m], which a fault leaves unchanged.
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
    detect_request: float = 0.0
    asked: float = 0.0
    width: float = MAX_HAND_WIDTH

    @property
    def holding(self) -> float:
        """1 while the object moves with the gripper, else 0."""
        return float(self.phase in HOLDING)


def next_state(state: SkillState, observation: Observation, config: SkillConfig) -> SkillState:
    """Returns the sequencer's memory after one control period.

    Args:
        state: The memory after the previous period.
        observation: The current observation.
        config: Thresholds and times.
    """
    phase = Phase(int(state.phase))
    if phase in (Phase.DONE, Phase.FAULT):
        return state
    state = _remember(phase, state, observation, config)
    ended = _has_ended(phase, state, observation, config)
    fault = _fault(phase, state, observation, config, ended)
    if fault is not Fault.NONE:
        return state._replace(
            phase=float(Phase.FAULT), phase_start=observation.time, fault=float(fault)
        )
    if not ended:
        return state
    following = Phase(phase + 1)
    return state._replace(
        phase=float(following),
        phase_start=observation.time,
        width=hand_width_of(following, config),
        still_since=np.nan,
        goal_since=np.nan,
        stuck_since=np.nan,
        best_error=np.inf,
        best_tau=-np.inf,
        progress_at=observation.time,
    )


def hand_width_of(phase: Phase, config: SkillConfig) -> float:
    """Returns the finger opening [m] to command in a phase other than FAULT."""
    return 0.0 if phase in _CLOSED_HAND else config.open_width


def _since(flag: bool, since: float, now: float) -> float:
    if not flag:
        return math.nan
    return now if math.isnan(since) else since


def _remember(
    phase: Phase, state: SkillState, observation: Observation, config: SkillConfig
) -> SkillState:
    now = observation.time
    elapsed = now - state.last_time
    travel = abs(observation.hand_width - state.last_width)
    still = elapsed > 0.0 and travel <= config.finger_still_speed * elapsed
    following = phase is Phase.FOLLOW
    waiting = phase is Phase.WAIT and not observation.tracking
    lost = waiting or (following and (observation.points_lost or not observation.tracking))
    lost_since = _since(lost, state.lost_since, now)
    ask = not state.asked and now - lost_since >= config.lost_grace
    # While the robot waits there is no fault, as whatever hides the part may go away.
    ask_again = waiting and ask
    progressed = observation.mean_error < state.best_error - config.progress_step or (
        observation.tau > state.best_tau + config.progress_step
    )
    return state._replace(
        last_width=observation.hand_width,
        last_time=now,
        still_since=_since(still and phase is Phase.GRASP, state.still_since, now),
        goal_since=_since(following and observation.at_goal, state.goal_since, now),
        lost_since=now if ask_again else lost_since,
        stuck_since=_since(observation.ik_stuck and phase in TWIST_PHASES, state.stuck_since, now),
        best_error=observation.mean_error if progressed else state.best_error,
        best_tau=float(np.fmax(observation.tau, state.best_tau)),  # A NaN is no progress.
        progress_at=now if progressed or not following or lost else state.progress_at,
        detect_request=state.detect_request + ask,
        asked=float(lost and not ask_again and (ask or state.asked)),
    )


def _stalled(state: SkillState, observation: Observation, config: SkillConfig) -> bool:
    return observation.time - state.progress_at > config.goal_patience


def _has_ended(
    phase: Phase, state: SkillState, observation: Observation, config: SkillConfig
) -> bool:
    """Returns whether `phase` ends now. A NaN in the observation does not end a phase."""
    elapsed = observation.time - state.phase_start
    match phase:
        case Phase.WAIT:
            return observation.tracking
        case Phase.GRASP:
            return (
                elapsed >= config.hand_delay + config.grasp_settle_time
                and observation.time - state.still_since >= config.grasp_settle_time
            )
        case Phase.FOLLOW:
            close = observation.goal_error <= config.accepted_error
            return observation.time - state.goal_since >= config.goal_hold_time or (
                close and _stalled(state, observation, config)
            )
        case Phase.RELEASE:
            return elapsed >= config.hand_delay + config.release_time
        case Phase.SETTLE:
            return elapsed >= config.settle_time
        case _:
            return observation.motion_done


def _fault(
    phase: Phase, state: SkillState, observation: Observation, config: SkillConfig, ended: bool
) -> Fault:
    """Returns the most severe fault, or NONE. `ended`: whether the phase ends now."""
    now, width = observation.time, observation.hand_width
    if not observation.safe:
        return Fault.SAFETY
    if math.isnan(width):
        return Fault.HAND_STATUS
    if now - state.lost_since >= config.lost_fault:
        return Fault.TRACKING_LOST
    if now - state.stuck_since >= config.stuck_time:
        return Fault.IK_STUCK
    if phase in HOLDING and width < config.closed_width:
        return Fault.OBJECT_DROPPED
    if phase is Phase.GRASP and width < config.closed_width:
        return Fault.GRASP_MISSED
    if phase is Phase.GRASP and ended and width >= config.open_width - _HARDLY_CLOSED:
        return Fault.HAND_IDLE
    far = not observation.goal_error <= config.accepted_error
    if phase is Phase.FOLLOW and far and _stalled(state, observation, config):
        return Fault.NO_PROGRESS
    if now - state.phase_start > config.phase_time_limit:
        return Fault.TIMEOUT
    return Fault.NONE
