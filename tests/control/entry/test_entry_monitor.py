import numpy as np
import pytest
from entry_runs import STEP, drive, shortfall
from entry_scenes import at, rod_scene, wall_scene
from numpy.testing import assert_array_equal

from poil_drake.control.entry.entry_monitor import safe_entry_step
from poil_drake.control.entry.entry_paths import TransitConfig
from poil_drake.control.entry.entry_state import EntryMonitorConfig, EntryState, EntryStatus
from poil_drake.control.entry.safe_entry import EntryKind, SafeEntryConfig
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig, BcsdmStatus, point_set_bcsdm
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_exp

START = at(0.0, -0.25, 0.06, 0.7)
OUTSIDE = at(0.1, 0.1, 0.3)
UNSEEN = np.full((8, 3), np.nan)
FALLBACK = EntryMonitorConfig(max_attempts=1, fallback="field", failed_period=3.0)


@pytest.fixture(scope="module")
def scene():
    return wall_scene()


@pytest.fixture(scope="module")
def planner(scene):
    return scene.planner()


@pytest.fixture(scope="module")
def closed_planner(scene):
    """A planner for the scene with the start enclosed in a box."""
    config = SafeEntryConfig(transit=TransitConfig(iterations=40))
    return scene.closed_in(START).planner(config)


@pytest.fixture(scope="module")
def points(scene):
    return scene.points_at(START)


@pytest.fixture(scope="module")
def raised(points):
    """A bad frame."""
    return points + np.array([0.0, 0.0, 0.08])


@pytest.fixture(scope="module")
def started(points, planner):
    """The state after a step at the start, at time 0."""
    return safe_entry_step(EntryState(), points, 0.0, planner)


def test_first_step_plans_and_evaluates_the_field_on_the_plan(points, planner, started):
    assert started.status is EntryStatus.FOLLOWING
    assert started.reference is started.plan.reference
    assert started.replans == 1
    expected = point_set_bcsdm(points, started.reference, planner.field)
    assert_array_equal(started.output.twist, expected.twist)


def test_it_waits_for_points(planner):
    state = safe_entry_step(EntryState(), UNSEEN, 0.0, planner)

    assert state.status is EntryStatus.WAITING
    assert state.output is None
    assert state.reference is None


def test_plan_is_kept_while_points_are_lost(planner, started):
    lost = safe_entry_step(started, UNSEEN, STEP, planner)

    assert lost.plan is started.plan
    assert lost.output.status is BcsdmStatus.LOST
    assert lost.tau == started.tau


def test_points_lost_while_holding_do_not_release_the_object(planner, started, raised):
    held = safe_entry_step(started, raised, 0.01, planner)

    lost = safe_entry_step(held, UNSEEN, 0.02, planner)

    assert held.status is lost.status is EntryStatus.HOLDING
    assert held.reference is lost.reference is None
    assert lost.plan is started.plan


def test_time_without_points_does_not_count_as_blocked(points, planner, started):
    state = started
    for time in np.arange(0.5, 5.0, 0.5):
        state = safe_entry_step(state, UNSEEN, time, planner)
    back = safe_entry_step(state, points, 5.0, planner)
    blocked = safe_entry_step(back, points, 6.75, planner)

    assert back.replans == 1
    # Observed without progress from 0 to 0.5 s, and for 1.75 s from 5 s on.
    assert blocked.recoveries == 1


def test_collinear_points_do_not_start_a_plan(points, planner, monkeypatch):
    def fail(*_, **__):
        raise AssertionError

    monkeypatch.setattr(planner, "plan", fail)
    collinear = points.copy()
    collinear[2:] = np.nan
    collinear[2] = points[:2].mean(axis=0)

    state = safe_entry_step(EntryState(), collinear, 0.0, planner)

    assert state.status is EntryStatus.WAITING
    assert state.plan is None
    monkeypatch.undo()
    assert safe_entry_step(state, points, 1 / 256, planner).plan is not None


def test_one_bad_frame_stops_the_object_without_another_plan(points, planner, started, raised):
    bad = safe_entry_step(started, raised, 0.01, planner)
    good = safe_entry_step(bad, points, 0.08, planner)

    assert bad.status is EntryStatus.HOLDING
    assert bad.output is None
    assert good.status is EntryStatus.FOLLOWING
    assert good.output is not None
    assert bad.plan is good.plan is started.plan
    assert good.replans == 1


def test_it_plans_again_after_the_patience(scene, planner, started):
    moved, state = scene.points_at(at(0.15, -0.25, 0.2)), started

    for time in (0.01, 0.08, 0.15):
        state = safe_entry_step(state, moved, time, planner)

    assert state.replans == 2
    assert state.status is EntryStatus.FOLLOWING
    assert np.abs(state.reference.positions[0] - moved).max() < 1e-6


def test_a_repeatedly_bad_track_does_not_cause_plans_forever(points, planner, raised):
    # The object stands still, so only a growing patience distinguishes bad frames from a push.
    config, state = EntryMonitorConfig(stall_time=np.inf), EntryState()

    for k in range(int(10.0 / STEP)):
        state = safe_entry_step(state, raised if k % 16 >= 8 else points, k * STEP, planner, config)

    # A quarter of a second is beyond the first patience of 0.1 s, and within the second of 0.3 s.
    assert state.returns == 1
    assert state.replans == 2


def test_patience_grows_up_to_its_limit():
    config = EntryMonitorConfig(patience=0.1, patience_step=0.2, max_patience=0.4)

    patience = [config.patience_after(returns) for returns in range(4)]

    assert patience == pytest.approx([0.1, 0.3, 0.4, 0.4])


@pytest.mark.parametrize("wrong", [{"patience": 3.0}, {"patience_step": -0.1}])
def test_shrinking_patience_is_rejected(wrong: dict):
    with pytest.raises(InvalidValueError, match="patience"):
        EntryMonitorConfig(**wrong)


def test_standing_still_does_not_count_as_blocked(points, planner, started, raised):
    config, state = EntryMonitorConfig(patience=2.0, max_patience=2.0, stall_time=1.0), started

    for time in np.arange(0.1, 1.8, 0.1):
        state = safe_entry_step(state, raised, time, planner, config)
        assert state.status is EntryStatus.HOLDING
    for time in (1.9, 2.0):
        state = safe_entry_step(state, points, time, planner, config)

    assert state.status is EntryStatus.FOLLOWING
    assert state.recoveries == 0


@pytest.mark.parametrize("push", [[0.1, -0.05, 0.0], [-0.1, 0.0, 0.05], [0.0, -0.1, 0.02]])
def test_a_pushed_object_gets_another_plan_and_reaches_the_goal(scene, planner, push: list):
    run = drive(scene, planner, START, pushes={40: at(*push)})

    assert run.reached
    assert run.states[-1].replans == 2
    assert shortfall(scene, run.X_WO, margin=0.005, slack=0.003).max() < 0.0


def test_a_slip_on_the_rod_is_corrected():
    rod = rod_scene()
    dut = rod.planner()
    X_WO = at(0.25, 0.05, 0.27, 0.2)
    threading = drive(rod, dut, X_WO)
    half_way = next(k for k, X in enumerate(threading.poses) if X[0, 3] < 0.1)
    # Along the rod, and turned about it.
    turn = np.eye(4)
    turn[:3, :3] = rotation_exp([0.2, 0, 0])
    slip = at(0.03, 0, 0.25) @ turn @ at(0, 0, -0.25)

    run = drive(rod, dut, X_WO, pushes={half_way: slip})

    assert run.reached
    assert shortfall(rod, run.X_WO, margin=0.003, slack=0.003).max() < 0.0


def test_an_unknown_obstacle_causes_a_limited_number_of_plans(points, planner):
    config, state = EntryMonitorConfig(), EntryState()

    for k in range(int(15.0 / STEP)):
        state = safe_entry_step(state, points, k * STEP, planner, config)

    assert state.recoveries == config.max_recoveries
    assert state.replans == 1 + config.max_recoveries
    assert state.output is not None


def test_without_a_path_it_holds_and_tries_again(points, closed_planner):
    config = EntryMonitorConfig(max_attempts=3, retry_period=0.5)
    statuses, state = [], EntryState()

    for time in np.arange(0.0, 2.0, 0.25):
        state = safe_entry_step(state, points, time, closed_planner, config)
        statuses.append(state.status)
        assert state.output is None

    assert statuses == [EntryStatus.HOLDING] * 4 + [EntryStatus.FAILED] * 4
    assert state.attempts == 3


@pytest.fixture(scope="module")
def failed(points, closed_planner):
    """A state in which planning has failed, at time 0."""
    state = safe_entry_step(
        EntryState(), points, 0.0, closed_planner, EntryMonitorConfig(max_attempts=1)
    )
    assert state.status is EntryStatus.FAILED
    return state


def test_after_planning_has_failed_attempts_are_less_frequent(
    points, planner, closed_planner, failed
):
    config = EntryMonitorConfig(max_attempts=1, failed_period=3.0)

    # With `planner`, the box is gone.
    early = safe_entry_step(failed, points, 2.9, planner, config)
    later = safe_entry_step(failed, points, 3.0, planner, config)
    in_vain = safe_entry_step(failed, points, 3.0, closed_planner, config)

    assert early is failed
    assert later.status is EntryStatus.FOLLOWING
    assert later.attempts == 0
    assert in_vain.status is EntryStatus.FAILED
    assert in_vain.attempts == 2


def test_after_planning_has_failed_a_moved_object_triggers_an_attempt(
    scene, points, closed_planner, failed
):
    config = EntryMonitorConfig(max_attempts=1, retry_period=0.5)
    moved, shaken = scene.points_at(OUTSIDE), points + 0.003
    shaken[0] = np.nan

    at_once = safe_entry_step(failed, moved, 0.4, closed_planner, config)
    soon = safe_entry_step(failed, moved, 0.5, closed_planner, config)
    not_moved = safe_entry_step(failed, shaken, 0.5, closed_planner, config)
    unseen = safe_entry_step(failed, UNSEEN, 0.5, closed_planner, config)

    assert soon.status is EntryStatus.FOLLOWING
    assert at_once is not_moved is unseen is failed


@pytest.fixture(scope="module")
def falling_back(points, closed_planner):
    """A state in which the paper's field has been followed since time 0."""
    return safe_entry_step(EntryState(), points, 0.0, closed_planner, FALLBACK)


def test_the_fallback_is_the_papers_field(scene, points, falling_back):
    assert falling_back.status is EntryStatus.FAILED
    assert falling_back.plan.kind is EntryKind.OFF
    expected = point_set_bcsdm(points, scene.reference, BcsdmConfig())
    assert_array_equal(falling_back.output.twist, expected.twist)


def test_the_fallback_searches_the_whole_reference_at_every_step(
    scene, closed_planner, falling_back
):
    times, positions = scene.reference.times, scene.reference.positions
    away = positions[-5] if falling_back.tau < 0.5 * times[-1] else positions[5]

    state = safe_entry_step(falling_back, away, STEP, closed_planner, FALLBACK)

    expected = point_set_bcsdm(away, scene.reference, BcsdmConfig())
    assert abs(expected.tau - falling_back.tau) > 1.0
    assert state.tau == expected.tau
    assert_array_equal(state.output.twist, expected.twist)


def test_the_fallback_plans_again_only_if_it_is_blocked(scene, points, planner, falling_back):
    early = safe_entry_step(falling_back, points, 2.5, planner, FALLBACK)
    blocked = safe_entry_step(falling_back, points, 3.0, planner, FALLBACK)
    moving = safe_entry_step(falling_back, scene.points_at(OUTSIDE), 3.0, planner, FALLBACK)

    assert early.plan.kind is moving.plan.kind is EntryKind.OFF
    assert blocked.plan.kind is EntryKind.SEARCHED
    assert blocked.status is EntryStatus.FOLLOWING


def test_the_fallback_continues_if_there_is_no_other_plan(points, closed_planner, falling_back):
    state = safe_entry_step(falling_back, points, 3.0, closed_planner, FALLBACK)

    assert state.attempts == 2
    assert state.plan is falling_back.plan
    assert_array_equal(state.output.twist, falling_back.output.twist)


def test_switched_off_every_step_is_the_papers(scene):
    dut = scene.planner(SafeEntryConfig(enabled=False))

    run = drive(scene, dut, START)

    assert run.reached
    for X_WO, state in list(zip(run.poses, run.states, strict=True))[::5]:
        expected = point_set_bcsdm(scene.points_at(X_WO), scene.reference, BcsdmConfig())
        assert_array_equal(state.output.twist, expected.twist)
