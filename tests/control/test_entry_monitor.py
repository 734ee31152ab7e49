import numpy as np
import pytest
from entry_runs import STEP, drive, shortfall
from entry_scenes import Scene, at, box, rod_scene, wall_scene
from numpy.testing import assert_array_equal

from poil_drake.control.bcsdm_config import BcsdmConfig
from poil_drake.control.entry_monitor import (
    EntryMonitorConfig,
    EntryState,
    EntryStatus,
    safe_entry_step,
)
from poil_drake.control.entry_transit import TransitConfig
from poil_drake.control.point_set_bcsdm import BcsdmStatus, point_set_bcsdm
from poil_drake.control.safe_entry import EntryKind, SafeEntryConfig
from poil_drake.geometry.rigid_transform import rotation_exp, transform_points

START = at(0.0, -0.25, 0.06, 0.7)
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
    state = safe_entry_step(EntryState(), np.full((8, 3), np.nan), 0.0, planner)

    assert state.status is EntryStatus.WAITING
    assert state.output is None
    assert state.reference is None


def test_the_plan_is_kept_while_points_are_lost(scene, planner):
    followed = safe_entry_step(EntryState(), points_at(scene, START), 0.0, planner)

    lost = safe_entry_step(followed, np.full((8, 3), np.nan), STEP, planner)

    assert lost.plan is followed.plan
    assert lost.output.status is BcsdmStatus.LOST
    assert lost.tau == followed.tau


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


def test_without_a_way_it_holds_tries_again_and_gives_up(closed):
    dut, config = closed.planner(QUICK), EntryMonitorConfig(max_attempts=3, retry_period=0.5)
    statuses, state = [], EntryState()

    for time in np.arange(0.0, 2.0, 0.25):
        state = safe_entry_step(state, points_at(closed, START), time, dut, config)
        statuses.append(state.status)
        assert state.output is None

    holding, failed = EntryStatus.HOLDING, EntryStatus.FAILED
    assert statuses == [holding] * 4 + [failed] * 4
    assert state.attempts == 3


def test_it_may_fall_back_to_the_papers_field(closed):
    dut = closed.planner(QUICK)
    config = EntryMonitorConfig(max_attempts=1, fallback="field")

    state = safe_entry_step(EntryState(), points_at(closed, START), 0.0, dut, config)

    assert state.status is EntryStatus.FAILED
    assert state.plan.kind is EntryKind.OFF
    papers = point_set_bcsdm(points_at(closed, START), closed.reference, BcsdmConfig())
    assert_array_equal(state.output.twist, papers.twist)


def test_switched_off_every_step_is_the_papers(scene):
    dut = scene.planner(SafeEntryConfig(enabled=False))

    run = drive(scene, dut, START)

    assert run.reached
    for X_WO, state in list(zip(run.poses, run.states, strict=True))[::5]:
        papers = point_set_bcsdm(points_at(scene, X_WO), scene.reference, BcsdmConfig())
        assert_array_equal(state.output.twist, papers.twist)
