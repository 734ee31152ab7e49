"""Commands to the drivers of the Panda and its hand."""

import math
import signal

import numpy as np
import pytest
from panda_bench import (
    JOINTS,
    LIMITER,
    PERIOD,
    FakeTime,
    RobotBench,
    arm_status,
    hand_status,
    make_arm_bench,
    make_hand_bench,
)
from system_bench import START

from poil_drake.errors import StationError
from poil_drake.robots.velocity_limiter import JointMotion
from poil_drake.systems.lcm import mailbox as lcm_mailbox
from poil_drake.systems.lcm import panda_senders
from poil_drake.systems.lcm.panda_messages import (
    HandOpening,
    encode_hand_command,
    encode_panda_command,
)
from poil_drake.systems.safety.faults import SafetyConfig
from poil_drake.systems.statuses import RobotMode


@pytest.fixture
def fake_time(monkeypatch: pytest.MonkeyPatch) -> FakeTime:
    time = FakeTime()
    monkeypatch.setattr(panda_senders, "time", time)
    return time


def test_before_the_first_status_nothing_is_known_and_nothing_is_sent(
    arm: RobotBench, hand: RobotBench
) -> None:
    assert hand.send(width=0.05) == []
    assert np.isnan(arm.show("position_measured")).all()
    assert arm.show("status").tolist() == [RobotMode.OTHER, np.inf, 0.0]
    assert arm.send(velocity=np.full(7, 0.1)) == []
    assert arm.rest(0.01) == []


def test_velocity_is_sent_in_the_drivers_format(arm: RobotBench) -> None:
    arm.report(arm_status(START))
    arm.elapsed += 0.25
    wanted = 0.1 * np.arange(7)

    (command,) = arm.send(velocity=wanted)

    assert command.utime == round(1e6 * (START + 0.25))
    assert command.control_mode_expected == 2
    assert (command.num_joint_position, command.num_joint_torque) == (0, 0)
    assert command.num_joint_velocity == 7
    np.testing.assert_array_equal(command.joint_velocity, wanted)


def test_rest_is_sent_for_missing_stale_and_nan_velocities(arm: RobotBench) -> None:
    arm.report(arm_status(START))
    wanted = np.full(7, 0.1)

    def is_rest(sent: list) -> bool:
        (command,) = sent
        return not any(command.joint_velocity)

    def rests_soon(*, time: float) -> bool:
        return any(is_rest(arm.send(velocity=wanted, velocity_time=time)) for _ in range(32))

    assert is_rest(arm.send())
    assert is_rest(arm.send(velocity=np.where(np.arange(7) == 3, np.nan, wanted)))
    assert not rests_soon(time=0.0)
    arm.context.SetTime(0.09)
    assert not rests_soon(time=0.0)
    arm.context.SetTime(0.11)
    assert rests_soon(time=0.0)
    arm.context.SetTime(0.0)
    assert not rests_soon(time=0.0)
    assert rests_soon(time=np.nan)


class HaltedBench(RobotBench):
    """Its process is halted for `halt` [s] just after it has checked the age of the update."""

    halt = 0.0

    @property
    def outdated(self) -> bool:
        self.elapsed += self.halt
        return False


def test_a_delayed_command_carries_its_true_age() -> None:
    arm = make_arm_bench(HaltedBench)
    arm.report(arm_status(START))
    arm.halt = 1.0

    (command,) = arm.send(velocity=np.full(7, 0.1))

    # The driver drops what is older than 0.1 s.
    assert arm.now() == START + 1.0
    assert command.utime == round(1e6 * START)


def test_commands_go_out_once_every_period(arm: RobotBench) -> None:
    arm.report(arm_status(START))
    arm.fix(velocity=np.full(7, 0.1))

    arm.advance_to(0.5)

    # One at the start, too.
    assert len(arm.sent) in (128, 129)


def speed_up(arm: RobotBench, *, speed: float) -> None:
    """Sends the velocities of the limiter, as the supervisor does, up to a speed [rad/s]."""
    motion = JointMotion.at_rest(np.array(JOINTS))
    while motion.velocity[1] < speed - 1e-9:
        motion = LIMITER.step(motion, np.full(7, speed))
        arm.send(velocity=motion.velocity)
    arm.send(velocity=motion.velocity)


def test_send_rest_brakes_as_the_supervisor(fake_time: FakeTime, arm: RobotBench) -> None:
    arm.report(arm_status(START))
    speed_up(arm, speed=0.6)

    sent = arm.rest(0.05)

    motion = JointMotion(np.zeros(7), np.full(7, 0.6), np.zeros(7))
    velocities = [command.joint_velocity for command in sent]
    expected = LIMITER.braking(motion)
    np.testing.assert_allclose(velocities[: len(expected)], expected, atol=1e-9)
    assert len(velocities) >= len(expected) + 0.05 / PERIOD
    assert not np.any(velocities[len(expected) :])
    assert not arm.dut.commanding


def test_after_a_suspended_send_rest_the_arm_is_still_commanded(
    fake_time: FakeTime, arm: RobotBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def halted_sleep(duration: float) -> None:
        fake_time.now += 10.0

    monkeypatch.setattr(fake_time, "sleep", halted_sleep)
    arm.report(arm_status(START))
    speed_up(arm, speed=0.6)

    sent = arm.rest(0.05)

    assert any(sent[-1].joint_velocity)
    assert arm.dut.commanding


def test_an_arm_that_speeds_up_brakes_within_its_limits(
    fake_time: FakeTime, arm: RobotBench
) -> None:
    arm.report(arm_status(START))
    speed_up(arm, speed=0.1)
    motion = JointMotion.at_rest(np.array(JOINTS))
    sent = []
    for _ in range(8):
        motion = LIMITER.step(motion, np.full(7, 2.0))
        sent.append(motion.velocity)
        arm.send(velocity=motion.velocity)

    sent += [command.joint_velocity for command in arm.rest(0.05)]

    accelerations = np.diff(sent, axis=0) / PERIOD
    jerks = np.diff(accelerations, axis=0) / PERIOD
    config = SafetyConfig().limiter
    assert np.all(np.abs(accelerations) <= LIMITER.acceleration + 1e-6)
    # The sender knows the acceleration only from velocities.
    assert np.all(np.abs(jerks) <= 1.5 * config.jerk_scale * np.array(config.jerk))


@pytest.mark.parametrize(("pause", "moves"), [(0.08, True), (0.12, False)])
def test_after_a_pause_there_is_nothing_to_brake_from(
    fake_time: FakeTime, arm: RobotBench, pause: float, moves: bool
) -> None:
    arm.report(arm_status(START))
    arm.send(velocity=np.full(7, 0.2))

    fake_time.sleep(pause)  # The driver's expiry is 0.1 s.
    sent = arm.rest(0.02)

    assert len(sent) > 4
    assert any(any(command.joint_velocity) for command in sent) == moves
    assert not any(sent[-1].joint_velocity)


class _StopError(Exception):
    pass


def test_a_signal_waits_until_the_arm_rests(
    fake_time: FakeTime, arm: RobotBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(number: int, frame: object) -> None:
        raise _StopError

    def interrupted_sleep(duration: float) -> None:
        signal.raise_signal(signal.SIGTERM)
        fake_time.now += duration

    monkeypatch.setattr(fake_time, "sleep", interrupted_sleep)
    arm.report(arm_status(START))
    arm.send(velocity=np.full(7, 0.2))
    arm.sent.clear()
    before = signal.signal(signal.SIGTERM, stop)
    try:
        with pytest.raises(_StopError):
            arm.dut.SendRest(0.1)
    finally:
        signal.signal(signal.SIGTERM, before)
    arm.lcm.HandleSubscriptions(0)

    assert len(arm.sent) > 10
    assert not any(arm.sent[-1].joint_velocity)


def test_the_arm_brakes_when_the_velocity_becomes_nan(arm: RobotBench) -> None:
    arm.report(arm_status(START))
    speed_up(arm, speed=0.6)
    expected = LIMITER.braking(JointMotion(np.zeros(7), np.full(7, 0.6), np.zeros(7)))

    found = [arm.send(velocity=np.full(7, np.nan))[0].joint_velocity for _ in expected]

    # Accelerations from sent velocities lag a little at each change of jerk.
    np.testing.assert_allclose(found, expected, atol=0.03)
    assert np.abs(found[-1]).max() < 0.03


def test_hand_gets_finite_commands_after_its_first_status(hand: RobotBench) -> None:
    hand.report(hand_status(0.08))
    assert hand.send() == []

    (command,) = hand.send(width=0.05)

    assert command.target_position_mm == pytest.approx(50.0)
    assert command.force == 40.0
    assert command.utime == round(1e6 * START)
    assert hand.send(width=float("nan")) == []


@pytest.mark.parametrize("robot", ["arm", "hand"])
def test_the_result_of_an_outdated_update_is_not_sent(
    robot: str, request: pytest.FixtureRequest
) -> None:
    bench: RobotBench = request.getfixturevalue(robot)
    bench.report(arm_status(START) if robot == "arm" else hand_status(0.08))
    inputs = {"velocity": np.full(7, 0.2)} if robot == "arm" else {"width": 0.05}
    assert len(bench.send(**inputs)) == 1

    bench.outdated = True

    assert bench.send(**inputs) == []


def test_initializing_a_simulator_sends_nothing_to_the_hand() -> None:
    hand = make_hand_bench(offset=0.003)
    hand.report(hand_status(0.08))
    hand.fix(width=0.05)

    hand.simulator.Initialize()
    hand.lcm.HandleSubscriptions(0)
    before = list(hand.sent)
    hand.advance_to(0.004)

    assert before == []
    assert len(hand.sent) == 1


@pytest.mark.parametrize(
    ("robot", "command", "said"),
    [
        ("arm", encode_panda_command(np.full(7, 0.2), START), "the robot"),
        ("hand", encode_hand_command(HandOpening(START, 0.0), 40.0), "the hand"),
    ],
)
def test_another_process_that_commands_the_robot_ends_the_run(
    robot: str, command: bytes, said: str, request: pytest.FixtureRequest
) -> None:
    bench: RobotBench = request.getfixturevalue(robot)
    bench.publish("COMMAND", command)

    with pytest.raises(StationError, match=f"commands {said} on the LCM channel COMMAND"):
        bench.send()


def test_echoes_of_own_commands_are_recognized(arm: RobotBench) -> None:
    arm.report(arm_status(START))

    for k in range(3):
        arm.elapsed = 0.004 * k
        assert len(arm.send(velocity=np.full(7, 0.1))) == 1

    assert arm.dut.channel.foreign == 0


@pytest.fixture
def patient_mailbox(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets senders take turns at any pace, since this machine may be slow."""
    monkeypatch.setattr(lcm_mailbox, "_WITHIN", math.inf)


@pytest.mark.usefixtures("patient_mailbox")
@pytest.mark.parametrize(
    "difference", [{"robot_utime": round(4e9)}, {"joint_position": [0.2] * 7}], ids=["clock", "arm"]
)
def test_two_drivers_that_take_turns_are_reported(arm: RobotBench, difference: dict) -> None:
    for k in range(20):
        now = {"robot_utime": 1000 * k, "joint_position": [0.0] * 7}
        other = {"robot_utime": 1000 * k + difference.get("robot_utime", 0)}
        changes = now | difference | other if k % 2 else now
        arm.report(arm_status(START + 0.001 * k, **changes))

    with pytest.raises(StationError, match="Two senders alternate on the LCM channel STATUS"):
        arm.show("status")
