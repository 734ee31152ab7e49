from functools import partial

import numpy as np
import pytest
from drake import lcmt_panda_command
from network_bench import NetworkBench

from poil_drake.errors import StationError
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.panda_messages import (
    PandaStatus,
    decode_panda_status,
    encode_panda_command,
)
from poil_drake.systems.lcm.simulated_driver import SimulatedDriver, SimulatedDriverConfig
from poil_drake.systems.statuses import RobotMode

PERIOD = 1 / 512
JOINTS = np.array([0.1, -0.2, 0.3, -1.5, 0.5, 1.6, 0.7])
WANTED = 0.1 * np.arange(7)


class DriverBench(NetworkBench):
    """The dut, with constant measurements, and a mailbox that receives its statuses."""

    def __init__(self, **config: float):
        make = partial(
            SimulatedDriver,
            command_channel="COMMAND",
            status_channel="STATUS",
            period=PERIOD,
            config=SimulatedDriverConfig(**config),
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


def test_between_steps_of_the_plant_the_position_is_extrapolated() -> None:
    bench = DriverBench(status_period=0.25 * PERIOD)
    bench.advance(0.125)

    bench.advance(0.75 * PERIOD)

    expected = JOINTS + 0.75 * PERIOD * 0.01 * np.arange(7)
    np.testing.assert_allclose(bench.status.position, expected, atol=1e-12)


def test_reflex_stops_the_arm_is_reported_and_ends_the_driver() -> None:
    bench = DriverBench(torque_limit=20.0)
    bench.command(WANTED)
    bench.advance(0.05)

    bench.fix(torque_external=np.array([0, 0, 0, -21.0, 0, 0, 0]))
    bench.advance(2 * PERIOD)
    bench.fix(torque_external=np.zeros(7))
    bench.command(WANTED)
    bench.advance(0.05)

    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))
    assert bench.status.mode is RobotMode.REFLEX
    with pytest.raises(StationError, match="reflex"):
        bench.advance(0.1)
