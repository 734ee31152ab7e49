"""Where an arm goes that is not exactly where it is commanded to be, or has to stop."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from panda_bench import FakeTime, arm_status, make_arm_bench
from supervised_cell import CELL, allowed_start, distance_from_cell, random_velocity
from supervisor_bench import LIMITS, MODEL, PERIOD, SupervisorBench
from system_bench import START

from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.posture_guard import PostureGuard
from poil_drake.systems.lcm import panda_senders
from poil_drake.systems.safety.faults import SafetyConfig, SafetyFault
from poil_drake.systems.statuses import RobotMode

CONFIG = SafetyConfig()
LOW = np.array([0.0, 0.3, 0.0, -2.2, 0.0, 2.5, np.pi / 4])
"""The hand hangs straight down, well above the table."""
DOWN = np.eye(7)[1]
LARGEST_CHANGE = CONFIG.limiter.acceleration_scale * LIMITS.acceleration * PERIOD


def moving(dut: SupervisorBench) -> np.ndarray:
    """Moves the arm for a fifth of a second, and returns its velocity."""
    velocity = 0.2 * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    dut.tick(50, velocity=velocity)
    return velocity


@pytest.mark.parametrize("speed", [0.3, 1.0])
@pytest.mark.parametrize("ahead", [0.03, 0.09])
def test_an_arm_that_is_ahead_keeps_above_the_table(speed: float, ahead: float) -> None:
    dut = SupervisorBench(LOW)
    dut.tick(20, velocity=speed * DOWN)

    dut.q = dut.q + ahead * DOWN
    dut.tick(400)

    assert dut.fault is SafetyFault.TABLE
    clearance = PostureGuard(model=MODEL).clearances(dut.q[None]).min()
    assert 0.0 <= clearance < 0.01


@pytest.mark.parametrize("ahead", [0.03, 0.09])
def test_an_arm_that_is_ahead_keeps_within_its_joints_limits(ahead: float) -> None:
    dut = SupervisorBench(NOMINAL_POSTURE)
    turn = np.eye(7)[6]
    dut.tick(20, velocity=turn)

    dut.q = dut.q + ahead * turn
    dut.tick(1500)

    assert dut.q[6] == pytest.approx(LIMITS.upper[6] - 0.05, abs=0.01)


def test_late_updates_account_for_the_motion_meanwhile() -> None:
    dut = SupervisorBench(NOMINAL_POSTURE, timed=True)
    moving(dut)

    for _ in range(10):
        dut.hold_up(0.05)
        dut.tick(2)

    assert dut.fault is SafetyFault.NONE
    # 0.5 s at 0.2 rad/s were not commanded tick by tick.
    np.testing.assert_allclose(dut.commanded, dut.q, atol=2e-3)


@pytest.mark.parametrize(("held_up", "moves"), [(0.09, True), (0.3, False)])
def test_after_a_suspension_the_arm_brakes_from_its_measured_motion(
    held_up: float, moves: bool
) -> None:
    dut = SupervisorBench(NOMINAL_POSTURE, timed=True)
    velocity = moving(dut)
    measured = 0.9 * velocity if moves else np.zeros(7)

    dut.hold_up(held_up)
    dut.tick(velocity_measured=measured)

    assert dut.fault is SafetyFault.LOOP_STALLED
    commanded = dut.velocities[-1]
    assert np.all(np.abs(commanded - measured) <= LARGEST_CHANGE + 1e-9)
    assert np.any(commanded) == moves


@pytest.mark.parametrize(
    ("held_up", "age", "expected"),
    [
        (1.0, 0.001, 0.0),  # The process was halted after it had read the status.
        (1.0, 0.95, 0.0),  # The status had waited in the socket.
        (0.15, 0.149, 0.0),
        (0.09, 0.089, 0.2),  # The driver still follows the last command.
    ],
)
def test_measurements_from_before_a_suspension_do_not_move_the_arm(
    held_up: float, age: float, expected: float
) -> None:
    dut = SupervisorBench(NOMINAL_POSTURE, timed=True)
    velocity = moving(dut)

    dut.hold_up(held_up)
    dut.tick(velocity_measured=0.9 * velocity, status=[float(RobotMode.MOVE), age, 1.0])

    assert dut.fault is SafetyFault.LOOP_STALLED
    commanded, braked = np.abs(dut.velocities[-1]), expected - LARGEST_CHANGE
    assert np.all(commanded <= expected)
    assert np.all(commanded >= braked)
    dut.tick(20)
    assert np.all(np.abs(dut.velocities[-20:]) <= expected)


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=15)
def test_no_limit_is_exceeded_while_coming_to_rest(seed: int) -> None:
    """At full speed, out of any motion."""
    rng = np.random.default_rng(seed)
    sender = make_arm_bench()
    sender.report(arm_status(START))
    dut = SupervisorBench(allowed_start(rng), config=SafetyConfig(posture=CELL))
    for _ in range(30):
        dut.inputs |= {"velocity": random_velocity(rng, dut.q)}
        for _ in range(rng.integers(3, 24)):
            dut.tick(reset=[float(len(dut.velocities))])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(panda_senders, "time", FakeTime())
            for velocity in dut.velocities[-2:]:
                sender.send(velocity=velocity)
            rest = [command.joint_velocity for command in sender.rest(0.01)]

        v = np.concatenate([dut.velocities[-1:], rest])
        q = dut.q + np.cumsum(0.5 * PERIOD * (v[:-1] + v[1:]), axis=0)
        assert not v[-1].any()
        assert np.all((q >= LIMITS.lower) & (q <= LIMITS.upper))
        assert np.all(np.abs(np.diff(v, axis=0)) <= PERIOD * LIMITS.acceleration)
        # The sender knows the acceleration only from two velocities.
        assert np.all(distance_from_cell(q) > -3e-3)
