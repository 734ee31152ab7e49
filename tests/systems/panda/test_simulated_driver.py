from functools import partial

import numpy as np
import pytest
from drake import lcmt_panda_command
from network_bench import NetworkBench

from poil_drake.errors import StationError
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.panda.lcm_messages import decode_panda_status, encode_panda_command
from poil_drake.systems.panda.simulated_driver import SimulatedDriver, SimulatedDriverConfig
from poil_drake.systems.statuses import RobotMode

PERIOD = 1 / 512
JOINTS = np.array([0.1, -0.2, 0.3, -1.5, 0.5, 1.6, 0.7])
WANTED = 0.1 * np.arange(7)


def make_bench(**config: float) -> NetworkBench:
    """The dut, with an arm that stands still."""
    make = partial(
        SimulatedDriver,
        command_channel="COMMAND",
        status_channel="STATUS",
        period=PERIOD,
        config=SimulatedDriverConfig(**config),
    )
    return NetworkBench(
        make,
        position_measured=JOINTS,
        velocity_measured=0.01 * np.arange(7),
        torque_external=np.arange(7.0),
        velocity_commanded=WANTED,
    )


@pytest.fixture
def bench() -> NetworkBench:
    return make_bench()


def test_velocity_is_passed_on_with_its_age(bench: NetworkBench) -> None:
    bench.advance(0.25)
    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))
    assert bench.read("velocity_time")[0] == -np.inf

    bench.publish("COMMAND", encode_panda_command(WANTED, bench.now() - 0.03))
    bench.advance(PERIOD)

    np.testing.assert_array_equal(bench.read("velocity"), WANTED)
    assert bench.time - bench.read("velocity_time")[0] == pytest.approx(0.03 + PERIOD, abs=1e-5)
    bench.advance(0.2)
    assert bench.time - bench.read("velocity_time")[0] == pytest.approx(0.23 + PERIOD, abs=1e-5)


@pytest.mark.parametrize("offset", [-0.2, 0.2])
def test_commands_by_another_clock_are_dropped(bench: NetworkBench, offset: float) -> None:
    bench.advance(0.25)

    bench.publish("COMMAND", encode_panda_command(WANTED, bench.now() + offset))
    bench.advance(PERIOD)

    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))


def test_last_command_wins(bench: NetworkBench) -> None:
    bench.publish("COMMAND", encode_panda_command(-WANTED, bench.now()))
    bench.publish("COMMAND", encode_panda_command(WANTED, bench.now()))
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
def test_wrong_modes_and_sizes_end_the_driver(bench: NetworkBench, changes: dict) -> None:
    command = lcmt_panda_command.decode(encode_panda_command(WANTED, bench.now()))
    for name, value in changes.items():
        setattr(command, name, value)

    bench.publish("COMMAND", command.encode())

    with pytest.raises(StationError, match="control mode"):
        bench.advance(PERIOD)


def test_status_is_reported_a_thousand_times_a_second(bench: NetworkBench) -> None:
    mailbox = LcmMailbox(bench.lcm, "STATUS", decode_panda_status)
    raw = bench.hear("STATUS")

    bench.advance(0.125)

    # One at the start, too.
    assert len(raw) in (128, 129)
    status = mailbox.newest
    assert status is not None
    assert mailbox.malformed == 0
    assert status.stamp == pytest.approx(bench.now(), abs=PERIOD + 1e-6)
    np.testing.assert_array_equal(status.position, JOINTS)  # At a step of the plant.
    np.testing.assert_allclose(status.velocity, 0.01 * np.arange(7))
    np.testing.assert_array_equal(status.torque_external, np.arange(7.0))
    assert status.mode is RobotMode.MOVE


def test_between_steps_of_the_plant_the_position_is_carried_on() -> None:
    bench = make_bench(status_period=0.25 * PERIOD)
    mailbox = LcmMailbox(bench.lcm, "STATUS", decode_panda_status)
    bench.advance(0.125)

    bench.advance(0.75 * PERIOD)

    status = mailbox.newest
    assert status is not None
    expected = JOINTS + 0.75 * PERIOD * 0.01 * np.arange(7)
    np.testing.assert_allclose(status.position, expected, atol=1e-12)


def test_reflex_stops_the_arm_is_reported_and_ends_the_driver() -> None:
    bench = make_bench(torque_limit=20.0)
    mailbox = LcmMailbox(bench.lcm, "STATUS", decode_panda_status)
    bench.publish("COMMAND", encode_panda_command(WANTED, bench.now()))
    bench.advance(0.05)

    bench.fix(torque_external=np.array([0, 0, 0, -21.0, 0, 0, 0]))
    bench.advance(2 * PERIOD)
    bench.fix(torque_external=np.zeros(7))
    bench.publish("COMMAND", encode_panda_command(WANTED, bench.now()))
    bench.advance(0.05)

    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))
    status = mailbox.newest
    assert status is not None
    assert status.mode is RobotMode.REFLEX
    with pytest.raises(StationError, match="reflex"):
        bench.advance(0.1)
