import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from supervised_cell import CELL, allowed_start, distance_from_cell, random_velocity
from supervisor_bench import LIMITS, MODEL, PERIOD, SupervisorBench

from poil_drake.errors import InvalidValueError
from poil_drake.robots.panda import NOMINAL_POSTURE
from poil_drake.robots.posture_guard import PostureGuard, PostureGuardConfig
from poil_drake.robots.velocity_limiter import JointMotion, VelocityLimiter
from poil_drake.systems.safety.faults import SafetyConfig, SafetyFault
from poil_drake.systems.safety.supervisor import SafetySupervisor
from poil_drake.systems.statuses import RobotMode

MOVE = float(RobotMode.MOVE)
CONFIG = SafetyConfig()
SLOW = SafetyConfig(limiter=replace(CONFIG.limiter, velocity_scale=0.2))
WANTED = 0.1 * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0])
LOW = np.array([0.0, 0.5, 0.0, -2.2, 0.0, 2.7, np.pi / 4])
"""The hand hangs straight down, its finger tips 4 cm above the table."""
DOWN = np.eye(7)[1]
"""The shoulder turns forward, which lowers the hand."""
FOLDING = np.array([0.0, -0.2, 0.0, -2.6, 0.0, 0.5, 0.0])
"""The hand is bent back towards the shoulder, which turning the elbow further brings nearer."""


def moving_bench(*, wanted: np.ndarray = WANTED, **arguments) -> SupervisorBench:
    """Returns a bench that has been moving for half a second."""
    bench = SupervisorBench(NOMINAL_POSTURE, **arguments)
    bench.tick(128, velocity=wanted)
    assert bench.fault is SafetyFault.NONE
    return bench


@pytest.mark.parametrize("ticks", [0, 50])
def test_before_the_first_status_the_arm_rests(ticks: int) -> None:
    dut = SupervisorBench(np.full(7, np.nan))

    nothing = {"status": [0.0, np.inf, 0.0], "torque_external": dut.q}
    dut.tick(ticks, velocity=WANTED, **nothing)

    assert not np.any(dut.velocities)
    assert not dut.read("velocity").any()
    assert dut.read("velocity_time")[0] == -np.inf
    assert dut.fault is SafetyFault.NONE
    assert dut.scale == 0.0


def test_a_safe_velocity_passes_through() -> None:
    dut = moving_bench()

    assert not dut.dut.HasAnyDirectFeedthrough()
    np.testing.assert_allclose(dut.read("velocity"), WANTED, atol=1e-12)
    assert dut.read("velocity_time")[0] == pytest.approx(dut.time - PERIOD)
    assert dut.scale == 1.0
    np.testing.assert_array_equal(dut.read("position"), dut.commanded)
    # The arm follows its commands.
    np.testing.assert_allclose(dut.commanded, dut.q, atol=1e-3)
    assert np.isnan(dut.read("updated_at")[0])


def test_a_step_is_that_of_the_limiter() -> None:
    dut = SupervisorBench(NOMINAL_POSTURE)
    limiter = VelocityLimiter(limits=LIMITS, period=PERIOD, config=CONFIG.limiter)
    expected = limiter.step(JointMotion.at_rest(np.array(NOMINAL_POSTURE)), WANTED)

    dut.tick(velocity=WANTED)

    np.testing.assert_array_equal(dut.read("velocity"), expected.velocity)
    np.testing.assert_array_equal(dut.commanded, expected.position)


def test_the_speed_override_holds() -> None:
    # A fifth of 2.175 rad/s is 0.435; half of the desired velocity.
    dut = moving_bench(wanted=0.87 * np.eye(7)[0], config=SLOW)

    assert dut.read("velocity")[0] == pytest.approx(0.435)
    assert dut.scale == pytest.approx(0.5)


def fresh(now: float) -> list[float]:
    return [now - PERIOD]


WELL = {
    "stop": [0.0],
    "velocity_time": fresh,
    "front.image_time": fresh,
    "status": [MOVE, 0.001, 1.0],
}
CAUSES = {
    SafetyFault.STOP_REQUESTED: {"stop": [1.0]},
    SafetyFault.NO_STATUS: {"status": lambda now: [MOVE, now - 0.5, 1.0]},
    SafetyFault.CLOCK_OFF: {"status": [MOVE, 100.0, 1.0]},
    SafetyFault.ROBOT_MODE: {"status": [float(RobotMode.USER_STOPPED), 0.001, 1.0]},
    SafetyFault.SUCCESS_RATE: {"status": [MOVE, 0.001, 0.5]},
    SafetyFault.COMMAND_STALE: {"velocity_time": [0.5]},
    SafetyFault.COMMAND_NOT_FINITE: {"velocity": np.r_[WANTED[:6], np.nan]},
    SafetyFault.EXTERNAL_TORQUE: {"torque_external": -12.1 * np.eye(7)[6]},
    SafetyFault.TRACKING_ERROR: {"position_measured": np.array(NOMINAL_POSTURE)},
    SafetyFault.CAMERA_STALE: {"front.image_time": [0.5]},
}
"""The inputs from half a second after the start. Images may be oldest: 1 s."""


@pytest.mark.parametrize("fault", CAUSES)
def test_a_cause_stops_the_arm_until_it_has_ended_and_a_reset_arrives(fault: SafetyFault) -> None:
    dut = SupervisorBench(NOMINAL_POSTURE, cameras=["front", "side"])
    dut.tick(128, velocity=WANTED, **WELL)
    assert (dut.fault, dut.scale) == (SafetyFault.NONE, 1.0)
    well = dict(dut.inputs)

    dut.tick(300, **CAUSES[fault])
    assert (dut.fault, dut.scale) == (fault, 0.0)
    assert not dut.read("velocity").any()

    # A request to stop does not persist, and an arm at rest has no tracking error.
    if fault not in {SafetyFault.STOP_REQUESTED, SafetyFault.TRACKING_ERROR}:
        dut.tick(20, reset=[1.0])
        assert dut.fault is fault

    dut.inputs = well | ({"stop": [1.0]} if fault is SafetyFault.STOP_REQUESTED else {})
    dut.tick(20)
    assert dut.fault is fault
    assert not dut.read("velocity").any()
    # Commands to rest are output all the time.
    assert dut.read("velocity_time")[0] == pytest.approx(dut.time - PERIOD)

    dut.tick(60, reset=[2.0])
    assert (dut.fault, dut.scale) == (SafetyFault.NONE, 1.0)
    np.testing.assert_allclose(dut.read("velocity"), WANTED, atol=1e-12)


@pytest.mark.parametrize(
    # All joints at the highest speed, and only the joint that brakes longest.
    "wanted",
    [0.2 * LIMITS.velocity, -0.2 * LIMITS.velocity, 0.2 * LIMITS.velocity * DOWN],
)
def test_the_arm_rests_soon_after_a_stop(wanted: np.ndarray) -> None:
    dut = SupervisorBench(NOMINAL_POSTURE, config=SLOW)
    dut.tick(40, velocity=wanted)
    np.testing.assert_allclose(dut.read("velocity"), wanted, atol=1e-9)

    # 0.15 s are 38.4 periods.
    dut.tick(38, stop=[1.0])

    assert not dut.read("velocity").any()
    q = dut.q
    dut.tick(100)
    np.testing.assert_array_equal(dut.q, q)


def test_without_a_status_the_arm_brakes_from_the_commanded_motion() -> None:
    dut, like = moving_bench(), moving_bench()

    # The position in an old status is elsewhere.
    dut.tick(30, status=[MOVE, 3.0, 1.0], position_measured=np.ones(7))
    like.tick(30, velocity=np.zeros(7))

    np.testing.assert_array_equal(dut.velocities, like.velocities)
    # An arm at rest is taken to be where it is measured, which rounds.
    np.testing.assert_allclose(dut.commanded, like.commanded, atol=1e-4)


@pytest.mark.parametrize("name", ["position_measured", "torque_external", "status", "velocity"])
def test_a_nan_input_brakes_the_arm(name: str) -> None:
    dut = moving_bench()
    size = dut.dut.GetInputPort(name).size()

    dut.tick(60, **{name: np.full(size, np.nan)})

    assert dut.fault is not SafetyFault.NONE
    assert not dut.read("velocity").any()
    assert np.isfinite(dut.velocities).all()


@pytest.mark.parametrize("speeds", [np.full(7, np.nan), 0.06 * DOWN])
def test_an_arm_starts_only_once_it_is_measured_at_rest(speeds: np.ndarray) -> None:
    dut = SupervisorBench(NOMINAL_POSTURE)

    dut.tick(20, velocity=WANTED, velocity_measured=speeds)
    assert not np.any(dut.velocities)
    dut.tick(20, velocity_measured=0.04 * DOWN)

    assert dut.read("velocity").any()


def test_a_standing_arm_is_taken_where_it_is_measured() -> None:
    dut = SupervisorBench(NOMINAL_POSTURE)
    dut.tick(20)
    pushed = np.array(NOMINAL_POSTURE) + 0.5 * DOWN

    dut.tick(position_measured=pushed)

    assert dut.fault is SafetyFault.NONE
    np.testing.assert_array_equal(dut.commanded, pushed)


def test_an_arm_moved_by_hand_after_a_fault_continues_from_there() -> None:
    dut = moving_bench()
    dut.tick(60, stop=[1.0])
    dut.q = np.array(NOMINAL_POSTURE) + 0.3 * DOWN

    dut.tick(2, reset=[1.0])

    assert dut.fault is SafetyFault.NONE
    np.testing.assert_allclose(dut.commanded, dut.q, atol=1e-3)


@pytest.mark.parametrize(
    ("start", "towards", "posture", "fault", "said"),
    [
        # The gripper point is 1 cm higher than the finger tips.
        (
            LOW,
            DOWN,
            {"gripper_lower": (-0.85, -0.85, 0.03)},
            SafetyFault.WORKSPACE,
            r"the gripper is \S+ mm from poil.safety.posture.gripper_lower\[2\], 0.03 m",
        ),
        (LOW, DOWN, {}, SafetyFault.TABLE, r"the arm is [2-6]\.\d mm above the table"),
        (
            FOLDING,
            -np.eye(7)[3],
            {},
            SafetyFault.SELF_COLLISION,
            "the wrist or the hand is close to the shoulder",
        ),
    ],
)
def test_the_arm_stops_before_it_breaks_a_rule(start, towards, posture, fault, said) -> None:
    config = PostureGuardConfig(**posture)
    dut = SupervisorBench(start, config=SafetyConfig(posture=config))
    guard = PostureGuard(model=MODEL, config=config)

    dut.tick(256, velocity=0.3 * towards)
    assert dut.fault is fault
    assert not dut.read("velocity").any()
    # 2 mrad of a joint are less than 2 mm at the hand.
    assert 0.0 <= guard.clearances(dut.q[None]).min() < 0.005

    problem = dut.dut.posture_problem(dut.context)
    assert problem is not None
    assert re.match(said, problem)

    # It stays there while the command continues, and may return.
    q = dut.q
    dut.tick(20, reset=[1.0])
    assert dut.fault is fault
    np.testing.assert_array_equal(dut.q, q)
    dut.tick(60, reset=[2.0], velocity=-0.3 * towards)
    assert (dut.fault, dut.scale) == (SafetyFault.NONE, 1.0)


def test_an_arm_that_breaks_a_rule_may_return() -> None:
    # The finger tips, 4 cm above the plane of the world, stand 1 cm below this table.
    config = SafetyConfig(posture=PostureGuardConfig(table_height=0.05))
    dut = SupervisorBench(LOW, config=config)

    dut.tick(20, velocity=0.1 * DOWN)
    assert dut.fault is SafetyFault.TABLE
    assert not np.any(dut.velocities)
    dut.tick(60, velocity=-0.1 * DOWN, reset=[1.0])

    assert dut.fault is SafetyFault.NONE
    np.testing.assert_allclose(dut.read("velocity"), -0.1 * DOWN, atol=1e-12)


def test_postures_within_the_last_ones_clearance_are_not_checked_again(monkeypatch) -> None:
    checks: list[np.ndarray] = []
    clearances = PostureGuard.clearances

    def counted(guard: PostureGuard, q: np.ndarray) -> np.ndarray:
        checks.append(q)
        return clearances(guard, q)

    def run() -> np.ndarray:
        checks.clear()
        dut = SupervisorBench(LOW - 0.5 * DOWN)
        dut.tick(600, velocity=0.4 * DOWN)
        assert dut.fault is SafetyFault.TABLE
        return np.array(dut.velocities)

    monkeypatch.setattr(PostureGuard, "clearances", counted)
    seldom, count = run(), len(checks)
    monkeypatch.setattr(PostureGuard, "largest_displacement", lambda guard, turns: np.inf)
    always = run()

    np.testing.assert_array_equal(seldom, always)
    assert count < len(checks) / 2


def test_it_stops_at_a_joint_limit_without_a_fault() -> None:
    dut = SupervisorBench(NOMINAL_POSTURE)

    dut.tick(1500, velocity=1.0 * np.eye(7)[6])

    # At the limiter's margin of 0.05 rad.
    assert dut.q[6] == pytest.approx(LIMITS.upper[6] - 0.05, abs=0.01)
    assert dut.fault is SafetyFault.NONE
    assert dut.scale == 0.0


def test_images_are_expected_only_after_the_first() -> None:
    dut = SupervisorBench(NOMINAL_POSTURE, cameras=["front"])
    dut.tick(600, velocity=WANTED)
    assert dut.fault is SafetyFault.NONE
    dut.tick(**{"front.image_time": lambda now: [now]})

    # After 256 ticks its image is a second old, not yet older.
    dut.tick(256, **{"front.image_time": [np.nan]})
    assert dut.fault is SafetyFault.NONE
    dut.tick()

    assert dut.fault is SafetyFault.CAMERA_STALE


def test_torques_and_joints_must_be_seven() -> None:
    with pytest.raises(InvalidValueError, match="external_torque"):
        SafetySupervisor(config=SafetyConfig(external_torque=(20.0,) * 6))


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=25)
def test_no_limit_is_exceeded_by_any_wanted_velocity(seed: int) -> None:
    """A thousand velocities: 25 times 40."""
    rng = np.random.default_rng(seed)
    dut = SupervisorBench(allowed_start(rng), config=SafetyConfig(posture=CELL))
    postures = [dut.q]
    for _ in range(40):
        # A fault of the last velocity ends once the arm is at rest.
        dut.inputs |= {"velocity": random_velocity(rng, dut.q)}
        for _ in range(rng.integers(3, 24)):
            dut.tick(reset=[float(len(postures))])
            postures.append(dut.q)

    q, v = np.array(postures), np.concatenate([np.zeros((1, 7)), dut.velocities])
    a = np.diff(v, axis=0, prepend=v[:1]) / PERIOD
    jerk = np.diff(a, axis=0, prepend=a[:1]) / PERIOD
    limiter = CONFIG.limiter
    assert np.all((q >= LIMITS.lower) & (q <= LIMITS.upper))
    assert np.all(np.abs(v) <= LIMITS.velocity + 1e-9)
    assert np.all(np.abs(a) <= limiter.acceleration_scale * LIMITS.acceleration + 1e-6)
    assert np.all(np.abs(jerk) <= limiter.jerk_scale * np.array(limiter.jerk) + 1e-3)
    # Between the postures that are checked, braking may violate the cell by less than 1 mm.
    assert np.all(distance_from_cell(q) > -1e-3)


def test_in_a_replay_the_arm_need_not_follow_its_commands() -> None:
    still = np.array(NOMINAL_POSTURE)
    held = {"position_measured": still, "velocity_measured": np.zeros(7)}
    live, replay = SupervisorBench(still), SupervisorBench(still)
    live.tick(1, **held)
    replay.tick(1, **held)

    # Two seconds at 0.1 rad/s are more than the leash of 0.1 rad.
    live.tick(512, velocity=WANTED)
    replay.tick(512, velocity=WANTED, position_commanded=still)

    assert live.fault is SafetyFault.TRACKING_ERROR
    assert replay.fault is SafetyFault.NONE
    np.testing.assert_allclose(replay.read("velocity"), WANTED, atol=1e-12)
    # One step from the posture of the run, not from the posture after its own commands.
    np.testing.assert_allclose(replay.read("position"), still + PERIOD * WANTED, atol=1e-9)
