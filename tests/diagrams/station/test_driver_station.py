"""A client and the simulated robot on an in-memory network, both on simulation time."""

import numpy as np
import pytest
from network_bench import NetworkBench

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.driver_station import MakeDriverStation
from poil_drake.errors import StationError
from poil_drake.systems.lcm import simulated_driver
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.panda_messages import decode_panda_status, encode_panda_command

WANTED = np.array([0.0, 0.0, 0.0, 0.0, 0.2, 0.0, -0.3])


class ClientBench(NetworkBench):
    """The dut and a client that commands the arm 256 times a second."""

    def __init__(self, scenario: Scenario):
        super().__init__(lambda **network: MakeDriverStation(scenario, **network).diagram)
        self.arm = LcmMailbox(self.lcm, "PANDA_STATUS", decode_panda_status)

    def drive(self, duration: float, velocity: np.ndarray) -> None:
        for _ in range(round(duration * 256)):
            self.publish("PANDA_COMMAND", encode_panda_command(velocity, self.now()))
            self.advance(1 / 256)


def test_arm_rests_when_commands_stop(scenario: Scenario) -> None:
    bench = ClientBench(scenario)
    bench.drive(0.3, WANTED)

    bench.advance(0.1 + 0.15)

    assert np.abs(bench.arm.newest.velocity).max() < 0.01
    stopped = bench.arm.newest.position
    bench.advance(0.2)
    np.testing.assert_allclose(bench.arm.newest.position, stopped, atol=1e-3)


def test_driver_ends_where_the_arm_runs_into_the_table(
    scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_driver, "_TORQUE_LIMIT", 20.0)
    bench = ClientBench(scenario)

    with pytest.raises(StationError, match="reflex"):
        bench.drive(4.0, np.array([0.0, 0.8, 0.0, 0.0, 0.0, 0.0, 0.0]))
