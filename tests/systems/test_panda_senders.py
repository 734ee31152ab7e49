"""What the drivers of the Panda and its hand are told."""

import os
import signal
import threading

import numpy as np
import pytest
from panda_bench import JOINTS, LIMITER, PERIOD, START, Bench, FakeTime, HandBench, status_message
from pydrake.systems.analysis import Simulator

from poil_drake.control.velocity_limiter import JointMotion
from poil_drake.errors import StationError
from poil_drake.systems import panda_senders
from poil_drake.systems.panda_lcm_messages import (
    encode_hand_command,
    encode_panda_command,
)
from poil_drake.systems.safety_faults import SafetyConfig
from poil_drake.systems.statuses import RobotMode


def test_before_the_first_status_nothing_is_known_and_nothing_is_sent() -> None:
    bench = Bench()

    assert np.isnan(bench.read("position_measured")).all()
    assert bench.read("status").tolist() == [RobotMode.OTHER, np.inf, 0.0]
    assert bench.send(np.full(7, 0.1)) == []
    bench.sender.SendRest(0.01)
    bench.lcm.HandleSubscriptions(0)
    assert bench.sent == []


def test_velocity_is_sent_as_the_driver_accepts_it() -> None:
    bench = Bench()
    bench.say(status_message(START).encode())
    bench.clock.now += 0.25
    wanted = 0.1 * np.arange(7)

    (command,) = bench.send(wanted)

    assert command.utime == round(1e6 * (START + 0.25))
    assert command.control_mode_expected == 2
    assert (command.num_joint_position, command.num_joint_torque) == (0, 0)
    assert command.num_joint_velocity == 7
    np.testing.assert_array_equal(command.joint_velocity, wanted)


def test_rest_is_sent_for_what_is_missing_stale_or_not_finite() -> None:
    bench = Bench(max_age=0.1)
    bench.say(status_message(START).encode())
    wanted = np.full(7, 0.1)

    def is_rest(sent: list) -> bool:
        (command,) = sent
        return not any(command.joint_velocity)

    def comes_to_rest(*, time: float) -> bool:
        return any(is_rest(bench.send(wanted, time=time)) for _ in range(32))

    assert is_rest(bench.send())
    assert is_rest(bench.send(np.where(np.arange(7) == 3, np.nan, wanted)))
    assert not comes_to_rest(time=0.0)
    bench.context.SetTime(0.09)
    assert not comes_to_rest(time=0.0)
    bench.context.SetTime(0.11)
    assert comes_to_rest(time=0.0)
    bench.context.SetTime(0.0)
    assert not comes_to_rest(time=0.0)
    assert comes_to_rest(time=np.nan)


class HaltedBench(Bench):
    """Its process is halted for a while [s] just after it has seen how old the update is."""

    halt = 0.0

    @property
    def update_age(self) -> float:
        self.clock.now += self.halt
        return 0.0

    @update_age.setter
    def update_age(self, value: float) -> None: ...


def test_a_command_that_was_held_up_says_how_old_it_is() -> None:
    bench = HaltedBench()
    bench.say(status_message(START).encode())
    bench.halt = 1.0

    (command,) = bench.send(np.full(7, 0.1))

    # The driver drops what is older than 0.1 s.
    assert bench.clock.now == START + 1.0
    assert command.utime == round(1e6 * START)


def test_braking_does_not_begin_from_what_was_commanded_long_ago(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time = FakeTime()
    monkeypatch.setattr(panda_senders, "time", time)
    bench = Bench()
    bench.say(status_message(START).encode())
    speed_up(bench, speed=0.6)

    time.now += 0.2
    (command,) = bench.send(np.full(7, np.nan))

    assert not any(command.joint_velocity)


def test_commands_go_out_once_every_period() -> None:
    bench = Bench()
    bench.say(status_message(START).encode())
    bench.sender.GetInputPort("velocity").FixValue(bench.context, np.full(7, 0.1))
    simulator = Simulator(bench.sender, bench.context)

    simulator.AdvanceTo(0.5)
    bench.lcm.HandleSubscriptions(0)

    # One at the start, too.
    assert len(bench.sent) in (128, 129)


def test_on_the_way_out_rest_is_sent_for_longer_than_the_driver_waits() -> None:
    bench = Bench()
    bench.say(status_message(START).encode())

    bench.sender.SendRest(0.15)
    bench.lcm.HandleSubscriptions(0)

    assert len(bench.sent) > 10
    assert all(not any(command.joint_velocity) for command in bench.sent)


def speed_up(bench: Bench, *, speed: float) -> None:
    """Sends what the supervisor would, until the arm has a velocity."""
    motion = JointMotion.at_rest(np.array(JOINTS))
    while motion.velocity[1] < speed - 1e-9:
        motion = LIMITER.step(motion, np.full(7, speed))
        bench.send(motion.velocity)
    bench.send(motion.velocity)


def test_on_the_way_out_the_arm_brakes_as_the_supervisor_would(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(panda_senders, "time", FakeTime())
    bench = Bench()
    bench.say(status_message(START).encode())
    speed_up(bench, speed=0.6)
    bench.sent.clear()

    bench.sender.SendRest(0.05)
    bench.lcm.HandleSubscriptions(0)

    motion = JointMotion(np.zeros(7), np.full(7, 0.6), np.zeros(7))
    velocities = [command.joint_velocity for command in bench.sent]
    expected = LIMITER.braking(motion)
    np.testing.assert_allclose(velocities[: len(expected)], expected, atol=1e-9)
    assert len(velocities) >= len(expected) + 0.05 / PERIOD
    assert not np.any(velocities[len(expected) :])


def test_an_arm_that_speeds_up_brakes_within_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(panda_senders, "time", FakeTime())
    bench = Bench()
    bench.say(status_message(START).encode())
    speed_up(bench, speed=0.1)  # It would go on to 2 rad/s.
    motion = JointMotion.at_rest(np.array(JOINTS))
    sent = []
    for _ in range(8):
        motion = LIMITER.step(motion, np.full(7, 2.0))
        sent.append(motion.velocity)
        bench.send(motion.velocity)
    bench.sent.clear()

    bench.sender.SendRest(0.05)
    bench.lcm.HandleSubscriptions(0)

    sent += [command.joint_velocity for command in bench.sent]
    accelerations = np.diff(sent, axis=0) / PERIOD
    jerks = np.diff(accelerations, axis=0) / PERIOD
    config = SafetyConfig().limiter
    assert np.all(np.abs(accelerations) <= LIMITER.acceleration + 1e-6)
    # How fast it speeds up is known from velocities only.
    assert np.all(np.abs(jerks) <= 1.5 * config.jerk_scale * np.array(config.jerk))


@pytest.mark.parametrize(("pause", "moves"), [(0.04, True), (0.08, True), (0.12, False)])
def test_after_a_pause_there_is_nothing_to_brake_from(
    monkeypatch: pytest.MonkeyPatch, pause: float, moves: bool
) -> None:
    time = FakeTime()
    monkeypatch.setattr(panda_senders, "time", time)
    bench = Bench()
    bench.say(status_message(START).encode())
    bench.send(np.full(7, 0.2))
    bench.sent.clear()

    time.sleep(pause)  # The driver's expiry is 0.1 s.
    bench.sender.SendRest(0.02)
    bench.lcm.HandleSubscriptions(0)

    assert len(bench.sent) > 4
    assert any(any(command.joint_velocity) for command in bench.sent) == moves
    assert not any(bench.sent[-1].joint_velocity)


class _StopError(Exception):
    pass


def test_a_signal_waits_until_the_arm_rests() -> None:
    def stop(number: int, frame: object) -> None:
        raise _StopError

    bench = Bench()
    bench.say(status_message(START).encode())
    bench.send(np.full(7, 0.2))
    bench.sent.clear()
    before = signal.signal(signal.SIGTERM, stop)
    timer = threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGTERM))
    timer.start()
    try:
        with pytest.raises(_StopError):
            rest_and_wait(bench, timer)
    finally:
        signal.signal(signal.SIGTERM, before)
    bench.lcm.HandleSubscriptions(0)

    assert len(bench.sent) > 10
    assert not any(bench.sent[-1].joint_velocity)


def rest_and_wait(bench: Bench, timer: threading.Timer) -> None:
    bench.sender.SendRest(0.1)
    timer.join()


def test_what_an_update_of_long_ago_found_is_not_sent() -> None:
    bench = Bench()
    bench.say(status_message(START).encode())
    bench.update_age = 0.079
    assert len(bench.send(np.full(7, 0.2))) == 1

    bench.update_age = 0.081

    assert bench.send(np.full(7, 0.2)) == []


def test_a_velocity_that_is_no_number_any_more_makes_the_arm_brake() -> None:
    bench = Bench()
    bench.say(status_message(START).encode())
    speed_up(bench, speed=0.6)
    expected = LIMITER.braking(JointMotion(np.zeros(7), np.full(7, 0.6), np.zeros(7)))

    found = [bench.send(np.full(7, np.nan))[0].joint_velocity for _ in expected]

    # From what was sent it is known how the arm brakes, a little late at each change of jerk.
    np.testing.assert_allclose(found, expected, atol=0.03)
    assert np.abs(found[-1]).max() < 0.03


def test_hand_is_told_what_is_known_once_it_answers() -> None:
    bench = HandBench()
    assert bench.send(0.05) == []
    bench.say(0.08)

    (command,) = bench.send(0.05)

    assert command.target_position_mm == pytest.approx(50.0)
    assert command.force == 40.0
    assert command.utime == round(1e6 * START)
    assert bench.send(float("nan")) == []


def test_hand_is_not_told_what_an_update_of_long_ago_found() -> None:
    bench = HandBench()
    bench.say(0.08)
    bench.update_age = 0.081

    assert bench.send(0.05) == []


def test_hand_is_not_told_anything_while_a_simulator_is_initialized() -> None:
    bench = HandBench(offset=0.003)
    bench.say(0.08)
    bench.sender.GetInputPort("width").FixValue(bench.context, [0.05])
    simulator = Simulator(bench.sender, bench.context)

    simulator.Initialize()
    bench.lcm.HandleSubscriptions(0)
    before = list(bench.sent)
    simulator.AdvanceTo(0.004)
    bench.lcm.HandleSubscriptions(0)

    assert before == []
    assert len(bench.sent) == 1


def test_somebody_else_who_commands_the_hand_ends_the_run() -> None:
    bench = HandBench()
    bench.say(0.08)
    bench.send(0.05)
    bench.lcm.Publish("COMMAND", encode_hand_command(0.0, 40.0, START))
    bench.lcm.HandleSubscriptions(0)

    with pytest.raises(StationError, match="Somebody else commands the hand on COMMAND"):
        bench.send(0.05)


def test_hand_that_nobody_commands_is_left_alone() -> None:
    bench = HandBench()
    bench.say(0.08)

    assert bench.send(None) == []


def test_own_commands_are_no_surprise_when_they_come_back() -> None:
    bench = Bench()
    bench.say(status_message(START).encode())

    for k in range(3):
        bench.clock.now = START + 0.004 * k
        assert len(bench.send(np.full(7, 0.1))) == 1

    assert bench.sender.channel.foreign == 0


def test_somebody_else_who_commands_the_arm_ends_the_run() -> None:
    bench = Bench()
    bench.say(status_message(START).encode())
    bench.send(np.full(7, 0.1))
    bench.lcm.Publish("COMMAND", encode_panda_command(np.full(7, 0.2), START))
    bench.lcm.HandleSubscriptions(0)

    with pytest.raises(StationError, match="Somebody else commands the robot on COMMAND"):
        bench.send()


def test_two_drivers_that_take_turns_are_told() -> None:
    bench = Bench()
    for k in range(20):
        own = 1e3 if k % 2 else 5e3  # Since which each robot's clock runs.
        stamp = START + 0.001 * k
        said = status_message(stamp, robot_utime=round(1e6 * (own + 0.001 * k)))
        bench.say(said.encode())

    with pytest.raises(StationError, match="Two senders take turns on STATUS"):
        bench.read("status")


def test_two_arms_in_different_postures_are_told() -> None:
    bench = Bench()
    for k in range(20):
        position = [0.2 * (k % 2)] * 7
        bench.say(status_message(START + 0.001 * k, joint_position=position).encode())

    with pytest.raises(StationError, match="Two senders take turns on STATUS"):
        bench.read("status")
