from functools import partial

import numpy as np
import pytest
from drake import lcmt_panda_command, lcmt_schunk_wsg_status
from network_bench import NetworkBench

from poil_drake.errors import StationError
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.panda_messages import (
    HAND_PERIOD,
    HandOpening,
    PandaStatus,
    decode_panda_status,
    encode_hand_command,
    encode_panda_command,
)
from poil_drake.systems.lcm.simulated_driver import SimulatedDriver, SimulatedHand
from poil_drake.systems.statuses import RobotMode

PERIOD = 1 / 512
JOINTS = np.array([0.1, -0.2, 0.3, -1.5, 0.5, 1.6, 0.7])
WANTED = 0.1 * np.arange(7)


class DriverBench(NetworkBench):
    """The dut, with constant measurements, and a mailbox that receives its statuses."""

    def __init__(self) -> None:
        make = partial(
            SimulatedDriver,
            command_channel="COMMAND",
            status_channel="STATUS",
            period=PERIOD,
        )
        super().__init__(
            make,
            position_measured=JOINTS,
            velocity_measured=0.01 * np.arange(7),
            torque_external=np.arange(7.0),
            velocity_commanded=WANTED,
        )
        self.mailbox = LcmMailbox(self.lcm, "STATUS", decode_panda_status)

    @property
    def status(self) -> PandaStatus:
        assert self.mailbox.newest is not None
        return self.mailbox.newest

    def command(self, velocity: np.ndarray, *, age: float = 0.0) -> None:
        self.publish("COMMAND", encode_panda_command(velocity, self.now() - age))


@pytest.fixture
def bench() -> DriverBench:
    return DriverBench()


def test_velocity_is_passed_on_with_its_age(bench: DriverBench) -> None:
    bench.advance(0.25)
    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))
    assert bench.read("velocity_time")[0] == -np.inf

    bench.command(WANTED, age=0.03)
    bench.advance(PERIOD)

    np.testing.assert_array_equal(bench.read("velocity"), WANTED)
    assert bench.time - bench.read("velocity_time")[0] == pytest.approx(0.03 + PERIOD, abs=1e-5)
    bench.advance(0.2)
    assert bench.time - bench.read("velocity_time")[0] == pytest.approx(0.23 + PERIOD, abs=1e-5)


@pytest.mark.parametrize("age", [-0.2, 0.2])
def test_commands_by_another_clock_are_dropped(bench: DriverBench, age: float) -> None:
    bench.advance(0.25)

    bench.command(WANTED, age=age)
    bench.advance(PERIOD)

    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))


def test_last_command_wins(bench: DriverBench) -> None:
    bench.command(-WANTED)
    bench.command(WANTED)
    bench.publish("COMMAND", b"noise")
    bench.advance(PERIOD)

    np.testing.assert_array_equal(bench.read("velocity"), WANTED)


@pytest.mark.parametrize(
    "changes",
    [
        {"control_mode_expected": 1},
        {"num_joint_velocity": 6, "joint_velocity": [0.0] * 6},
        {"num_joint_position": 7, "joint_position": [0.0] * 7},
    ],
)
def test_wrong_modes_and_sizes_end_the_driver(bench: DriverBench, changes: dict) -> None:
    command = lcmt_panda_command.decode(encode_panda_command(WANTED, bench.now()))
    for name, value in changes.items():
        setattr(command, name, value)

    bench.publish("COMMAND", command.encode())

    with pytest.raises(StationError, match="control mode"):
        bench.advance(PERIOD)


def test_status_is_reported_a_thousand_times_a_second(bench: DriverBench) -> None:
    raw = bench.hear("STATUS")

    bench.advance(0.125)

    # One at the start, too.
    assert len(raw) in (128, 129)
    assert bench.mailbox.malformed == 0
    status = bench.status
    assert status.stamp == pytest.approx(bench.now(), abs=PERIOD + 1e-6)
    np.testing.assert_array_equal(status.position, JOINTS)  # At a step of the plant.
    np.testing.assert_allclose(status.velocity, 0.01 * np.arange(7))
    np.testing.assert_array_equal(status.torque_external, np.arange(7.0))
    assert status.mode is RobotMode.MOVE


def test_between_steps_of_the_plant_the_position_is_extrapolated(bench: DriverBench) -> None:
    bench.advance(0.125)

    bench.advance(0.5 * PERIOD)

    expected = JOINTS + 0.5 * PERIOD * 0.01 * np.arange(7)
    np.testing.assert_allclose(bench.status.position, expected, atol=1e-12)


def test_reflex_stops_the_arm_is_reported_and_ends_the_driver(bench: DriverBench) -> None:
    bench.command(WANTED)
    bench.advance(0.05)

    bench.fix(torque_external=np.array([0, 0, 0, -101.0, 0, 0, 0]))
    bench.advance(2 * PERIOD)
    bench.fix(torque_external=np.zeros(7))
    bench.command(WANTED)
    bench.advance(0.05)

    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))
    assert bench.status.mode is RobotMode.REFLEX
    with pytest.raises(StationError, match="reflex"):
        bench.advance(0.1)


@pytest.fixture
def hand() -> NetworkBench:
    make = partial(SimulatedHand, command_channel="COMMAND", status_channel="STATUS")
    return NetworkBench(make, width_measured=0.08)


def command_hand(hand: NetworkBench, width: float) -> None:
    hand.publish("COMMAND", encode_hand_command(HandOpening(hand.now(), width), 40.0))


def test_before_the_first_command_the_hand_has_no_target(hand: NetworkBench) -> None:
    hand.advance(3 * HAND_PERIOD)

    assert np.isnan(hand.read("width"))


def test_a_hands_width_is_taken_at_the_next_update(hand: NetworkBench) -> None:
    hand.advance(HAND_PERIOD)

    command_hand(hand, 0.03)
    hand.advance(2 * HAND_PERIOD)

    assert hand.read("width") == pytest.approx(0.03)


def test_the_hands_next_command_is_executed_after_the_motion(hand: NetworkBench) -> None:
    command_hand(hand, 0.03)
    hand.advance(HAND_PERIOD)
    command_hand(hand, 0.05)

    for width in (0.07, 0.06, 0.05, 0.04):
        hand.fix(width_measured=width)
        hand.advance(HAND_PERIOD)
        assert hand.read("width") == pytest.approx(0.03)

    # The fingers are blocked and at rest.
    hand.advance(2 * HAND_PERIOD)
    assert hand.read("width") == pytest.approx(0.05)


def test_the_hands_status_has_the_width_and_no_force(hand: NetworkBench) -> None:
    statuses = hand.hear("STATUS", lcmt_schunk_wsg_status.decode)
    hand.fix(width_measured=0.042)

    hand.advance(5 * HAND_PERIOD)

    assert len(statuses) in (5, 6)
    assert statuses[-1].actual_position_mm == pytest.approx(42.0)
    assert {status.actual_force for status in statuses} == {0.0}
    assert statuses[-1].actual_speed_mm_per_s == 0.0
    assert statuses[-1].utime == pytest.approx(1e6 * hand.now(), abs=1.1e5)


def test_a_moving_hand_reports_the_drivers_speed(hand: NetworkBench) -> None:
    statuses = hand.hear("STATUS", lcmt_schunk_wsg_status.decode)

    command_hand(hand, 0.03)
    hand.advance(HAND_PERIOD)

    assert statuses[-1].actual_speed_mm_per_s == 5.0
