"""Both ends of the robot's network: the hardware's and the simulated robot's, on one clock."""

import dataclasses
import math

import numpy as np
import pytest
from diagram_wiring import ports
from network_bench import NetworkBench
from pydrake.systems.framework import DiagramBuilder
from system_bench import SystemBench

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.driver_station import MakeDriverStation
from poil_drake.diagrams.station.hardware.panda_hardware import AddPandaHardware
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.errors import StationError
from poil_drake.systems.lcm import simulated_driver
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.panda_messages import decode_panda_status, encode_panda_command
from poil_drake.systems.statuses import RobotMode

PERIOD = 1 / 256
WANTED = np.array([0.0, 0.0, 0.0, 0.0, 0.2, 0.0, -0.3])


class HardwareBench(SystemBench):
    """The dut and a simulated robot, advanced in turn."""

    def __init__(self, scenario: Scenario, *, dry_run: bool = False) -> None:
        self.robot = NetworkBench(lambda **network: MakeDriverStation(scenario, **network).diagram)
        builder = DiagramBuilder()
        self.hardware = AddPandaHardware(
            builder=builder,
            lcm=self.robot.lcm,
            scenario=scenario,
            dry_run=dry_run,
            clock=self.robot.now,
        )
        super().__init__(builder.Build())

    def advance(self, duration: float) -> None:
        for _ in range(round(duration / PERIOD)):
            self.robot.advance(PERIOD)
            super().advance(PERIOD)


@pytest.fixture
def scenario() -> Scenario:
    """The package's scenario, without cameras."""
    return dataclasses.replace(ChooseScenario(), cameras={})


@pytest.fixture
def bench(scenario: Scenario) -> HardwareBench:
    return HardwareBench(scenario)


@pytest.mark.parametrize("dry_run", [False, True])
def test_ports_are_those_of_the_simulated_robot(scenario: Scenario, dry_run: bool) -> None:
    bench = HardwareBench(scenario, dry_run=dry_run)
    station_inputs, station_outputs = ports(MakeStation(scenario, cameras=False))

    inputs, outputs = ports(bench.dut)

    assert inputs.items() <= station_inputs.items()
    assert outputs.items() <= station_outputs.items()
    cheats = {"body_poses", "contact_results", "query_object", "plant_state"}
    assert set(station_inputs) - set(inputs) == {"applied_spatial_force"}
    assert set(station_outputs) - set(outputs) == cheats


def test_arm_moves_as_commanded_and_reports_its_motion(bench: HardwareBench) -> None:
    bench.advance(0.1)
    before = bench.read("panda.position_measured")

    bench.fix("panda.velocity", WANTED)
    bench.advance(0.5)

    moved = bench.read("panda.position_measured") - before
    # The joints' controllers lag by a few hundredths of a second.
    np.testing.assert_allclose(moved, 0.5 * WANTED, atol=0.025)
    mode, age, success = bench.read("panda.status")
    assert mode == RobotMode.MOVE
    assert abs(age) < 0.02
    assert success == 1.0


def test_hand_opens_and_closes(bench: HardwareBench) -> None:
    bench.advance(0.2)

    for width in (0.03, 0.07):
        bench.fix("hand.width", width)
        bench.advance(1.3)
        assert bench.read("hand.width_measured")[0] == pytest.approx(width, abs=2e-3)


def test_before_the_first_status_nothing_moves(bench: HardwareBench) -> None:
    bench.fix("panda.velocity", WANTED)

    bench.simulator.AdvanceTo(0.1)  # without the robot

    assert np.isnan(bench.read("panda.position_measured")).all()
    assert bench.read("panda.status")[1] == np.inf
    assert bench.robot.time == 0.0


def test_nothing_is_sent_long_after_an_update(bench: HardwareBench) -> None:
    bench.advance(0.1)
    sender, pump = bench.hardware.sender, bench.dut.GetSubsystemByName("lcm")
    sent = bench.robot.hear("PANDA_COMMAND")
    bench.robot.lcm.HandleSubscriptions(0)
    sent.clear()

    for handled_at in (-math.inf, math.inf):
        pump.handled_at = handled_at
        sender.ForcedPublish(sender.GetMyContextFromRoot(bench.context))
        bench.robot.lcm.HandleSubscriptions(0)
        assert len(sent) == (handled_at > 0.0)


def test_in_a_dry_run_the_motion_is_shown_and_nothing_is_sent(scenario: Scenario) -> None:
    bench = HardwareBench(scenario, dry_run=True)
    sent = [bench.robot.hear(name) for name in ("PANDA_COMMAND", "PANDA_HAND_COMMAND")]
    bench.advance(0.1)
    before = bench.read("panda.position_measured")
    real = bench.hardware.arm.newest

    bench.fix("panda.velocity", WANTED)
    bench.fix("hand.width", 0.03)
    bench.advance(0.5)

    np.testing.assert_allclose(before, real.position, atol=1e-6)
    moved = bench.read("panda.position_measured") - before
    np.testing.assert_allclose(moved, 0.5 * WANTED, atol=2 * PERIOD)
    assert bench.read("hand.width_measured")[0] == pytest.approx(0.03, abs=1e-6)
    assert sent == [[], []]
    assert bench.hardware.sender is None
    np.testing.assert_allclose(bench.hardware.arm.newest.position, before, atol=1e-5)


class ClientBench(NetworkBench):
    """The simulated robot and a client that commands the arm 256 times a second."""

    def __init__(self, scenario: Scenario):
        super().__init__(lambda **network: MakeDriverStation(scenario, **network).diagram)
        self.arm = LcmMailbox(self.lcm, "PANDA_STATUS", decode_panda_status)

    def drive(self, duration: float, velocity: np.ndarray) -> None:
        for _ in range(round(duration / PERIOD)):
            self.publish("PANDA_COMMAND", encode_panda_command(velocity, self.now()))
            self.advance(PERIOD)


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
