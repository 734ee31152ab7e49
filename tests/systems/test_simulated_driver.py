import numpy as np
import pytest
from drake import lcmt_panda_command
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator

from poil_drake.errors import StationError
from poil_drake.systems.lcm_mailbox import LcmMailbox
from poil_drake.systems.panda_lcm_messages import (
    decode_panda_status,
    encode_panda_command,
)
from poil_drake.systems.simulated_driver import SimulatedDriver, SimulatedDriverConfig
from poil_drake.systems.statuses import RobotMode

PERIOD = 1 / 512
START = 1_790_000_000.0
JOINTS = np.array([0.1, -0.2, 0.3, -1.5, 0.5, 1.6, 0.7])
WANTED = 0.1 * np.arange(7)


class Bench:
    """The dut with an arm that stands still, and a client on the same network in memory.

    Both clocks run with the simulation.
    """

    def __init__(self, **config: float):
        self.lcm = DrakeLcm("memq://driver")
        self.dut = SimulatedDriver(
            lcm=self.lcm,
            command_channel="COMMAND",
            status_channel="STATUS",
            period=PERIOD,
            config=SimulatedDriverConfig(**config),
            clock=self.now,
        )
        self.simulator = Simulator(self.dut)
        self.context = self.simulator.get_mutable_context()
        self.fix("position_measured", JOINTS)
        self.fix("velocity_measured", 0.01 * np.arange(7))
        self.fix("torque_external", np.arange(7.0))
        self.fix("velocity_commanded", WANTED)
        self.mailbox = LcmMailbox(self.lcm, "STATUS", decode_panda_status)

    def now(self) -> float:
        return START + self.context.get_time()

    def fix(self, name: str, value: np.ndarray) -> None:
        self.dut.GetInputPort(name).FixValue(self.context, value)

    def say(self, message: bytes) -> None:
        self.lcm.Publish("COMMAND", message)
        self.lcm.HandleSubscriptions(0)

    def advance(self, duration: float = PERIOD) -> None:
        self.simulator.AdvanceTo(self.context.get_time() + duration)
        self.lcm.HandleSubscriptions(0)

    def read(self, name: str) -> np.ndarray:
        return self.dut.GetOutputPort(name).Eval(self.context)

    @property
    def age(self) -> float:
        return self.context.get_time() - self.read("velocity_time")[0]


def test_before_the_first_command_the_arm_is_told_to_rest() -> None:
    bench = Bench()

    bench.advance(0.1)

    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))
    assert bench.read("velocity_time")[0] == -np.inf


def test_velocity_is_passed_on_with_its_age() -> None:
    bench = Bench()
    bench.advance(0.25)

    bench.say(encode_panda_command(WANTED, bench.now() - 0.03))
    bench.advance()

    np.testing.assert_array_equal(bench.read("velocity"), WANTED)
    assert bench.age == pytest.approx(0.03 + PERIOD, abs=1e-5)
    bench.advance(0.2)
    assert bench.age == pytest.approx(0.23 + PERIOD, abs=1e-5)


@pytest.mark.parametrize("offset", [-0.2, 0.2, 1.0, -1.0])
def test_commands_by_another_clock_are_dropped(offset: float) -> None:
    bench = Bench()
    bench.advance(0.25)

    bench.say(encode_panda_command(WANTED, bench.now() + offset))
    bench.advance()

    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))


def test_last_command_wins() -> None:
    bench = Bench()

    bench.say(encode_panda_command(-WANTED, bench.now()))
    bench.say(encode_panda_command(WANTED, bench.now()))
    bench.say(b"noise")
    bench.advance()

    np.testing.assert_array_equal(bench.read("velocity"), WANTED)


@pytest.mark.parametrize(
    "changes",
    [
        {"control_mode_expected": 1},
        {"num_joint_velocity": 6, "joint_velocity": [0.0] * 6},
        {"num_joint_position": 7, "joint_position": [0.0] * 7},
    ],
)
def test_wrong_modes_and_sizes_end_the_driver(changes: dict) -> None:
    bench = Bench()
    command = lcmt_panda_command.decode(encode_panda_command(WANTED, START))
    for name, value in changes.items():
        setattr(command, name, value)

    bench.say(command.encode())

    with pytest.raises(StationError, match="control mode"):
        bench.advance()


def test_status_is_reported_a_thousand_times_a_second() -> None:
    bench = Bench()
    raw: list[bytes] = []
    bench.lcm.Subscribe("STATUS", raw.append)

    bench.advance(0.125)

    # One at the start, too.
    assert len(raw) in (128, 129)
    status = bench.mailbox.newest
    assert status is not None
    assert bench.mailbox.malformed == 0
    assert status.stamp == pytest.approx(bench.now(), abs=PERIOD + 1e-6)
    np.testing.assert_array_equal(status.position, JOINTS)  # At a step of the plant.
    np.testing.assert_allclose(status.velocity, 0.01 * np.arange(7))
    np.testing.assert_array_equal(status.torque_external, np.arange(7.0))
    assert status.mode is RobotMode.MOVE


def test_between_steps_of_the_plant_the_position_is_carried_on() -> None:
    bench = Bench(status_period=0.25 * PERIOD)
    bench.advance(0.125)

    bench.advance(0.75 * PERIOD)

    status = bench.mailbox.newest
    assert status is not None
    expected = JOINTS + 0.75 * PERIOD * 0.01 * np.arange(7)
    np.testing.assert_allclose(status.position, expected, atol=1e-12)


def test_reflex_stops_the_arm_is_reported_and_ends_the_driver() -> None:
    bench = Bench(torque_limit=20.0, reflex_sec=0.1)
    bench.say(encode_panda_command(WANTED, bench.now()))
    bench.advance(0.05)

    bench.fix("torque_external", np.array([0, 0, 0, -21.0, 0, 0, 0]))
    bench.advance(2 * PERIOD)
    bench.fix("torque_external", np.zeros(7))
    bench.say(encode_panda_command(WANTED, bench.now()))
    bench.advance(0.05)

    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))
    status = bench.mailbox.newest
    assert status is not None
    assert status.mode is RobotMode.REFLEX
    with pytest.raises(StationError, match="reflex"):
        bench.advance(0.1)
