import numpy as np
import pytest
from entry_runs import STEP, drive, shortfall
from entry_scenes import Scene, at, box, rod_scene, wall_scene
from numpy.testing import assert_array_equal

from poil_drake.control.entry.entry_monitor import safe_entry_step
from poil_drake.control.entry.entry_state import EntryMonitorConfig, EntryState, EntryStatus
from poil_drake.control.entry.entry_transit import TransitConfig
from poil_drake.control.entry.safe_entry import EntryKind, SafeEntryConfig
from poil_drake.control.field.bcsdm_config import BcsdmConfig
from poil_drake.control.field.point_set_bcsdm import BcsdmStatus, point_set_bcsdm
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_exp, transform_points

START = at(0.0, -0.25, 0.06, 0.7)
OUTSIDE = at(0.1, 0.1, 0.3)
UNSEEN = np.full((8, 3), np.nan)
QUICK = SafeEntryConfig(transit=TransitConfig(iterations=40))


@pytest.fixture(scope="module")
def scene():
    return wall_scene()


@pytest.fixture(scope="module")
def planner(scene):
    return scene.planner()


@pytest.fixture(scope="module")
def closed(scene):
    """The same with the start locked into a box."""
    cage = box([0.2, 0.2, 0.2], START[:3, 3] + [0, 0, 0.06])
    return Scene(**{**vars(scene), "obstacles": np.concatenate([scene.obstacles, cage])})


def points_at(scene, X_WO):
    return transform_points(X_WO, scene.points)


def test_first_step_plans_and_gives_the_field_on_the_plan(scene, planner):
    points = points_at(scene, START)

    state = safe_entry_step(EntryState(), points, 0.0, planner)

    assert state.status is EntryStatus.FOLLOWING
    assert state.reference is state.plan.reference
    assert state.replans == 1
    expected = point_set_bcsdm(points, state.reference, planner.field)
    assert_array_equal(state.output.twist, expected.twist)


def test_it_waits_for_points(scene, planner):
    state = safe_entry_step(EntryState(), UNSEEN, 0.0, planner)

    assert state.status is EntryStatus.WAITING
    assert state.output is None
    assert state.reference is None


def test_the_plan_is_kept_while_points_are_lost(scene, planner):
    followed = safe_entry_step(EntryState(), points_at(scene, START), 0.0, planner)

    lost = safe_entry_step(followed, UNSEEN, STEP, planner)

    assert lost.plan is followed.plan
    assert lost.output.status is BcsdmStatus.LOST
    assert lost.tau == followed.tau


def test_points_lost_while_it_holds_do_not_release_the_object(scene, planner):
    points = points_at(scene, START)
    followed = safe_entry_step(EntryState(), points, 0.0, planner)
    held = safe_entry_step(followed, points + np.array([0.0, 0.0, 0.08]), 0.01, planner)

    lost = safe_entry_step(held, UNSEEN, 0.02, planner)

    assert held.status is lost.status is EntryStatus.HOLDING
    assert held.reference is lost.reference is None
    assert lost.plan is followed.plan


def test_time_without_points_does_not_count_as_blocked(scene, planner):
    points = points_at(scene, START)
    state = safe_entry_step(EntryState(), points, 0.0, planner)

    for time in np.arange(0.5, 5.0, 0.5):
        state = safe_entry_step(state, UNSEEN, time, planner)
    back = safe_entry_step(state, points, 5.0, planner)
    blocked = safe_entry_step(back, points, 6.75, planner)

    assert back.replans == 1
    # Seen without progress from 0 to 0.5 s, and for 1.75 s from 5 s on.
    assert blocked.recoveries == 1


def test_points_on_a_line_are_no_start_and_cost_no_plan(scene, planner, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError

    monkeypatch.setattr(planner, "plan", refuse)
    points = points_at(scene, START)
    points[2:] = np.nan
    points[2] = points[:2].mean(axis=0)

    state = safe_entry_step(EntryState(), points, 0.0, planner)

    assert state.status is EntryStatus.WAITING
    assert state.plan is None
    monkeypatch.undo()
    later = safe_entry_step(state, points_at(scene, START), 1 / 256, planner)
    assert later.plan is not None


def test_state_stays_as_it_was(scene, planner):
    first = safe_entry_step(EntryState(), points_at(scene, START), 0.0, planner)
    before = dict(vars(first))

    safe_entry_step(first, points_at(scene, at(0.1, -0.3, 0.2)), 1.0, planner)

    assert vars(first) == before


def test_a_bad_frame_stops_it_and_does_not_make_another_plan(scene, planner):
    points = points_at(scene, START)
    first = safe_entry_step(EntryState(), points, 0.0, planner)

    bad = safe_entry_step(first, points + np.array([0.0, 0.0, 0.08]), 0.01, planner)
    good = safe_entry_step(bad, points, 0.08, planner)

    assert bad.status is EntryStatus.HOLDING
    assert bad.output is None
    assert bad.plan is first.plan
    assert good.status is EntryStatus.FOLLOWING
    assert good.output is not None
    assert good.plan is first.plan
    assert good.replans == 1


def test_after_the_patience_there_is_another_plan(scene, planner):
    moved = points_at(scene, at(0.15, -0.25, 0.2))
    state = safe_entry_step(EntryState(), points_at(scene, START), 0.0, planner)

    for time in (0.01, 0.08, 0.15):
        state = safe_entry_step(state, moved, time, planner)

    assert state.replans == 2
    assert state.status is EntryStatus.FOLLOWING
    assert np.abs(state.reference.positions[0] - moved).max() < 1e-6


def test_a_track_that_is_bad_again_and_again_does_not_make_plans_for_ever(scene, planner):
    # Where the object stands still, only a growing patience tells bad frames from a push.
    config = EntryMonitorConfig(stall_time=np.inf)
    good = points_at(scene, START)
    bad = good + np.array([0.0, 0.0, 0.08])
    state = EntryState()

    for k in range(int(10.0 / STEP)):
        state = safe_entry_step(state, bad if k % 16 >= 8 else good, k * STEP, planner, config)

    # A quarter of a second is beyond the first patience of 0.1 s, and within the second of 0.3 s.
    assert state.returns == 1
    assert state.replans == 2


def test_patience_grows_up_to_its_limit():
    config = EntryMonitorConfig(patience=0.1, patience_step=0.2, max_patience=0.4)

    patience = [config.patience_after(returns) for returns in range(4)]

    assert patience == pytest.approx([0.1, 0.3, 0.4, 0.4])


@pytest.mark.parametrize("wrong", [{"patience": 3.0}, {"patience_step": -0.1}])
def test_patience_that_shrinks_is_refused(wrong: dict):
    with pytest.raises(InvalidValueError, match="patience"):
        EntryMonitorConfig(**wrong)


def test_standing_still_does_not_count_as_blocked(scene, planner):
    config = EntryMonitorConfig(patience=2.0, max_patience=2.0, stall_time=1.0)
    points = points_at(scene, START)
    raised = points + np.array([0.0, 0.0, 0.08])
    state = safe_entry_step(EntryState(), points, 0.0, planner, config)

    for time in np.arange(0.1, 1.8, 0.1):
        state = safe_entry_step(state, raised, time, planner, config)
        assert state.status is EntryStatus.HOLDING
    for time in (1.9, 2.0):
        state = safe_entry_step(state, points, time, planner, config)

    assert state.status is EntryStatus.FOLLOWING
    assert state.recoveries == 0


@pytest.mark.parametrize("push", [[0.1, -0.05, 0.0], [-0.1, 0.0, 0.05], [0.0, -0.1, 0.02]])
def test_a_push_in_mid_run_leads_to_another_plan_and_to_the_goal(scene, planner, push: list):
    run = drive(scene, planner, START, pushes={40: at(*push)})

    assert run.reached
    assert run.states[-1].replans == 2
    assert shortfall(scene, run.X_WO, margin=0.005, slack=0.003).max() < 0.0


def test_a_slip_on_the_rod_is_led_back(scene):
    rod = rod_scene()
    dut = rod.planner()
    X_WO = at(0.25, 0.05, 0.27, 0.2)
    threading = drive(rod, dut, X_WO)
    half_way = next(k for k, X in enumerate(threading.poses) if X[0, 3] < 0.1)
    # Along the rod, and turned about it.
    slip = at(0.03, 0, 0.25) @ np.block(
        [[rotation_exp([0.2, 0, 0]), np.zeros((3, 1))], [np.zeros((1, 3)), 1.0]]
    )

    run = drive(rod, dut, X_WO, pushes={half_way: slip @ at(0, 0, -0.25)})

    assert run.reached
    assert shortfall(rod, run.X_WO, margin=0.003, slack=0.003).max() < 0.0


def test_an_obstacle_that_nobody_knows_leads_to_a_bounded_number_of_plans(scene, planner):
    config, points = EntryMonitorConfig(), points_at(scene, START)
    state = EntryState()

    for k in range(int(15.0 / STEP)):
        state = safe_entry_step(state, points, k * STEP, planner, config)

    assert state.recoveries == config.max_recoveries
    assert state.replans == 1 + config.max_recoveries
    assert state.output is not None


def test_without_a_way_it_holds_and_tries_again(closed):
    dut, config = closed.planner(QUICK), EntryMonitorConfig(max_attempts=3, retry_period=0.5)
    statuses, state = [], EntryState()

    for time in np.arange(0.0, 2.0, 0.25):
        state = safe_entry_step(state, points_at(closed, START), time, dut, config)
        statuses.append(state.status)
        assert state.output is None

    holding, failed = EntryStatus.HOLDING, EntryStatus.FAILED
    assert statuses == [holding] * 4 + [failed] * 4
    assert state.attempts == 3


@pytest.fixture(scope="module")
def failed(closed):
    """A state in which planning has failed, at time 0."""
    config = EntryMonitorConfig(max_attempts=1)
    state = safe_entry_step(
        EntryState(), points_at(closed, START), 0.0, closed.planner(QUICK), config
    )
    assert state.status is EntryStatus.FAILED
    return state


def test_after_it_has_failed_it_tries_less_often(scene, closed, planner, failed):
    config, points = EntryMonitorConfig(max_attempts=1, failed_period=3.0), points_at(scene, START)

    # The cage is gone.
    early = safe_entry_step(failed, points, 2.9, planner, config)
    later = safe_entry_step(failed, points, 3.0, planner, config)
    in_vain = safe_entry_step(failed, points, 3.0, closed.planner(QUICK), config)

    assert early is failed
    assert later.status is EntryStatus.FOLLOWING
    assert later.attempts == 0
    assert in_vain.status is EntryStatus.FAILED
    assert in_vain.attempts == 2


def test_after_it_has_failed_it_tries_anew_where_the_object_is_put(closed, failed):
    dut, config = closed.planner(QUICK), EntryMonitorConfig(max_attempts=1, retry_period=0.5)
    moved, shaken = points_at(closed, OUTSIDE), points_at(closed, START) + 0.003
    shaken[0] = np.nan

    at_once = safe_entry_step(failed, moved, 0.4, dut, config)
    soon = safe_entry_step(failed, moved, 0.5, dut, config)
    not_moved = safe_entry_step(failed, shaken, 0.5, dut, config)
    unseen = safe_entry_step(failed, UNSEEN, 0.5, dut, config)

    assert at_once is failed
    assert soon.status is EntryStatus.FOLLOWING
    assert not_moved is failed
    assert unseen is failed


@pytest.fixture(scope="module")
def falling_back(closed):
    """A state in which the paper's field is followed since time 0."""
    config = EntryMonitorConfig(max_attempts=1, fallback="field")
    return safe_entry_step(
        EntryState(), points_at(closed, START), 0.0, closed.planner(QUICK), config
    )


def test_it_may_fall_back_to_the_papers_field(closed, falling_back):
    assert falling_back.status is EntryStatus.FAILED
    assert falling_back.plan.kind is EntryKind.OFF
    papers = point_set_bcsdm(points_at(closed, START), closed.reference, BcsdmConfig())
    assert_array_equal(falling_back.output.twist, papers.twist)


def test_falling_back_the_whole_reference_is_searched_at_every_step(closed, falling_back):
    config = EntryMonitorConfig(max_attempts=1, fallback="field")
    times, positions = closed.reference.times, closed.reference.positions
    away = positions[-5] if falling_back.tau < 0.5 * times[-1] else positions[5]

    state = safe_entry_step(falling_back, away, STEP, closed.planner(QUICK), config)

    papers = point_set_bcsdm(away, closed.reference, BcsdmConfig())
    assert abs(papers.tau - falling_back.tau) > 1.0
    assert state.tau == papers.tau
    assert_array_equal(state.output.twist, papers.twist)


def test_falling_back_it_plans_again_only_where_it_is_blocked(scene, planner, falling_back):
    config = EntryMonitorConfig(max_attempts=1, fallback="field", failed_period=3.0)
    points = points_at(scene, START)

    early = safe_entry_step(falling_back, points, 2.5, planner, config)
    blocked = safe_entry_step(falling_back, points, 3.0, planner, config)
    moving = safe_entry_step(falling_back, points_at(scene, OUTSIDE), 3.0, planner, config)

    assert early.plan.kind is moving.plan.kind is EntryKind.OFF
    assert blocked.plan.kind is EntryKind.SEARCHED
    assert blocked.status is EntryStatus.FOLLOWING


def test_falling_back_goes_on_where_there_is_no_other_plan(closed, falling_back):
    config = EntryMonitorConfig(max_attempts=1, fallback="field", failed_period=3.0)

    state = safe_entry_step(
        falling_back, points_at(closed, START), 3.0, closed.planner(QUICK), config
    )

    assert state.attempts == 2
    assert state.plan is falling_back.plan
    assert_array_equal(state.output.twist, falling_back.output.twist)


def test_switched_off_every_step_is_the_papers(scene):
    dut = scene.planner(SafeEntryConfig(enabled=False))

    run = drive(scene, dut, START)

    assert run.reached
    for X_WO, state in list(zip(run.poses, run.states, strict=True))[::5]:
        papers = point_set_bcsdm(points_at(scene, X_WO), scene.reference, BcsdmConfig())
        assert_array_equal(state.output.twist, papers.twist)
