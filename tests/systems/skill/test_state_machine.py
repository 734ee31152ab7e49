import dataclasses

import numpy as np
import pytest

from poil_drake.systems.skill.phases import Fault, Phase
from poil_drake.systems.skill.state_machine import (
    Observation,
    SkillConfig,
    SkillState,
    hand_width_of,
    next_state,
)

CONFIG = SkillConfig()
SEEN = Observation(
    time=1.0,
    tracking=True,
    at_goal=False,
    points_lost=False,
    tau=0.0,
    mean_error=0.1,
    goal_error=0.1,
    motion_done=False,
    ik_stuck=False,
    hand_width=0.0035,
    safe=True,
)
ON_THE_WAY = SEEN._replace(mean_error=0.001, goal_error=0.2)
UNKNOWN = SEEN._replace(mean_error=np.nan, goal_error=np.nan, tau=np.nan)
LOST = SEEN._replace(points_lost=True)


def in_phase(phase: Phase, **memory: float) -> SkillState:
    return SkillState(
        phase=float(phase),
        phase_start=0.9,
        last_time=0.9,
        last_width=0.0035,
        progress_at=0.9,
        width=hand_width_of(phase, CONFIG),
        **memory,
    )


def run(
    state: SkillState,
    seen: Observation,
    *,
    duration: float,
    tick: float = 1 / 256,
    config: SkillConfig = CONFIG,
) -> list[SkillState]:
    """Feeds one observation for a while and returns the states."""
    states = [state]
    for step in range(1, round(duration / tick) + 1):
        states.append(next_state(states[-1], seen._replace(time=seen.time + step * tick), config))
    return states


@pytest.mark.parametrize(
    ("phase", "seen", "following"),
    [
        (Phase.WAIT, SEEN, Phase.APPROACH),
        (Phase.WAIT, SEEN._replace(tracking=False), Phase.WAIT),
        (Phase.APPROACH, SEEN, Phase.APPROACH),
        (Phase.APPROACH, SEEN._replace(motion_done=True), Phase.DESCEND),
        (Phase.DESCEND, SEEN._replace(motion_done=True), Phase.GRASP),
        (Phase.LIFT, SEEN._replace(motion_done=True), Phase.FOLLOW),
        (Phase.RETREAT, SEEN._replace(motion_done=True), Phase.SETTLE),
    ],
)
def test_one_tick(phase: Phase, seen: Observation, following: Phase) -> None:
    assert Phase(int(next_state(in_phase(phase), seen, CONFIG).phase)) is following


def test_grasp_ends_when_the_fingers_stand_still() -> None:
    moving = in_phase(Phase.GRASP)._replace(last_width=0.02)
    one_tick = next_state(moving, SEEN, CONFIG)
    assert one_tick.phase == Phase.GRASP
    states = run(one_tick, SEEN, duration=CONFIG.grasp_settle_time + 0.05)
    assert states[-1].phase == Phase.LIFT
    entered = next(s for s in states if s.phase == Phase.LIFT).phase_start
    # The fingers count as at rest from the first tick after the moving one.
    assert entered == pytest.approx(SEEN.time + 1 / 256 + CONFIG.grasp_settle_time, abs=1e-9)


def test_goal_must_hold_before_release() -> None:
    at_goal = SEEN._replace(at_goal=True, mean_error=0.001, goal_error=0.001)
    held = run(in_phase(Phase.FOLLOW), at_goal, duration=CONFIG.goal_hold_time + 0.02)
    assert held[-1].phase == Phase.RELEASE
    flicker = next_state(held[5], SEEN._replace(time=held[5].last_time + 1 / 256), CONFIG)
    assert np.isnan(flicker.goal_since)


def test_a_small_residual_is_released_after_patience() -> None:
    close = SEEN._replace(mean_error=0.0, goal_error=CONFIG.accepted_error - 0.001)
    states = run(in_phase(Phase.FOLLOW), close, duration=CONFIG.goal_patience + 0.1)
    assert states[-1].phase == Phase.RELEASE


@pytest.mark.parametrize(
    ("phase", "seen", "duration", "fault"),
    [
        (Phase.FOLLOW, SEEN, CONFIG.goal_patience + 0.1, Fault.NO_PROGRESS),
        (Phase.FOLLOW, ON_THE_WAY, CONFIG.goal_patience + 0.1, Fault.NO_PROGRESS),
        (Phase.FOLLOW, UNKNOWN, CONFIG.goal_patience + 0.1, Fault.NO_PROGRESS),
        (Phase.FOLLOW, SEEN._replace(tracking=False), CONFIG.lost_fault + 0.1, Fault.TRACKING_LOST),
        (Phase.FOLLOW, LOST, CONFIG.lost_fault + 0.1, Fault.TRACKING_LOST),
        (Phase.FOLLOW, SEEN._replace(hand_width=0.0), 0.02, Fault.OBJECT_DROPPED),
        (Phase.LIFT, SEEN._replace(ik_stuck=True), CONFIG.stuck_time + 0.1, Fault.IK_STUCK),
        (Phase.GRASP, SEEN._replace(hand_width=0.0), 0.02, Fault.GRASP_MISSED),
        (
            Phase.GRASP,
            SEEN._replace(hand_width=CONFIG.open_width),
            CONFIG.grasp_settle_time + 0.05,
            Fault.HAND_IDLE,
        ),
        (Phase.APPROACH, SEEN._replace(safe=False), 0.02, Fault.SAFETY),
        (Phase.APPROACH, SEEN._replace(hand_width=np.nan), 0.02, Fault.HAND_STATUS),
        (Phase.APPROACH, SEEN, CONFIG.phase_time_limit, Fault.TIMEOUT),
    ],
)
def test_faults(phase: Phase, seen: Observation, duration: float, fault: Fault) -> None:
    last = run(in_phase(phase), seen, duration=duration)[-1]
    assert (Phase(int(last.phase)), Fault(int(last.fault))) == (Phase.FAULT, fault)


def test_detection_is_requested_once_after_the_grace_time() -> None:
    states = run(in_phase(Phase.FOLLOW), LOST, duration=CONFIG.lost_fault - 0.1)
    asked = [s.last_time for s in states if s.detect_request == 1.0]
    assert asked[0] == pytest.approx(SEEN.time + 1 / 256 + CONFIG.lost_grace, abs=1e-9)
    assert states[-1].detect_request == 1.0


def test_each_loss_requests_a_detection() -> None:
    once = run(in_phase(Phase.FOLLOW), LOST, duration=CONFIG.lost_grace + 0.1)[-1]
    again = run(once, SEEN._replace(time=once.last_time), duration=0.1)[-1]
    twice = run(again, LOST._replace(time=again.last_time), duration=CONFIG.lost_grace + 0.1)[-1]
    assert (once.detect_request, again.asked, twice.detect_request) == (1.0, 0.0, 2.0)


def test_while_the_robot_waits_detections_are_requested_repeatedly() -> None:
    hidden = SEEN._replace(tracking=False)
    waiting = run(in_phase(Phase.WAIT), hidden, duration=4.5 * CONFIG.lost_grace)[-1]
    begun = run(waiting, SEEN._replace(time=waiting.last_time), duration=0.1)[-1]
    assert (Phase(int(waiting.phase)), waiting.detect_request) == (Phase.WAIT, 4.0)
    assert (Phase(int(begun.phase)), begun.detect_request) == (Phase.APPROACH, 4.0)


def test_fingers_at_rest_before_they_could_have_moved_hold_nothing() -> None:
    config = dataclasses.replace(CONFIG, hand_delay=0.5)
    states = run(in_phase(Phase.GRASP), SEEN, duration=2.0, config=config)
    begun = next(s for s in states if s.phase == Phase.LIFT)
    assert begun.phase_start - 0.9 == pytest.approx(
        config.hand_delay + config.grasp_settle_time, abs=1 / 128
    )


def test_a_fault_leaves_the_fingers_as_they_are() -> None:
    open_ = next_state(in_phase(Phase.RETREAT), SEEN._replace(safe=False), CONFIG)
    shut = next_state(in_phase(Phase.FOLLOW), SEEN._replace(safe=False), CONFIG)
    assert (open_.width, shut.width) == (CONFIG.open_width, 0.0)


def test_lost_points_do_not_count_as_lack_of_progress() -> None:
    lost = UNKNOWN._replace(points_lost=True)
    states = run(in_phase(Phase.FOLLOW), lost, duration=CONFIG.goal_patience + 0.1)
    assert states[-1].phase == Phase.FOLLOW


@pytest.mark.parametrize(
    ("taus", "best_tau", "progress_at"),
    [((0.8, 1.001), 1.001, 1.5), ((0.8, 0.9), 1.0, 1.0), ((1.1,), 1.1, 1.25)],
)
def test_progress_is_that_beyond_the_farthest_before_a_loss(
    taus: tuple[float, ...], best_tau: float, progress_at: float
) -> None:
    state = in_phase(Phase.FOLLOW, best_error=0.1, best_tau=1.0)
    state = next_state(state, UNKNOWN._replace(points_lost=True, time=1.0), CONFIG)

    for tick, tau in enumerate(taus, start=1):
        state = next_state(state, SEEN._replace(tau=tau, time=1.0 + 0.25 * tick), CONFIG)

    assert (state.best_tau, state.progress_at) == (best_tau, progress_at)


@pytest.mark.parametrize("phase", [Phase.DONE, Phase.FAULT])
def test_ended_phases_stay(phase: Phase) -> None:
    state = in_phase(phase)
    assert next_state(state, SEEN._replace(safe=False), CONFIG) == state


def test_the_hand_is_closed_exactly_between_grasp_and_release() -> None:
    closed = {phase for phase in Phase if hand_width_of(phase, CONFIG) == 0.0}
    assert closed - {Phase.FAULT} == {Phase.GRASP, Phase.LIFT, Phase.FOLLOW}
