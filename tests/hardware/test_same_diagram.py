"""Swapping the simulated station for the real one changes nothing above it."""

from pathlib import Path

import pytest
from diagram_wiring import ports, wires
from hardware_bench import carrying_plan, hardware_scenario, stand_in

from poil_drake.diagrams.loop.closed_loop import ClosedLoop, MakeClosedLoop
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import HardwareStation, SimulatedStation
from poil_drake.recording.run_log.writer import RunLogWriter

pytestmark = pytest.mark.render


def systems(loop: ClosedLoop) -> dict[str, type]:
    found = {system.get_name(): type(system) for system in loop.diagram.GetSystems()}
    del found["station"]
    return found


def test_the_loop_is_the_same_but_for_its_station(
    scenario: Scenario, pictures: Path, tmp_path: Path
) -> None:
    scenario = hardware_scenario(scenario)
    with RunLogWriter(tmp_path / "simulated.mcap") as log:
        simulated = MakeClosedLoop(scenario, carrying_plan(), log=log)
        simulated.Close()
    with (
        RunLogWriter(tmp_path / "hardware.mcap") as log,
        stand_in(scenario, pictures, tmp_path) as robot,
    ):
        hardware = MakeClosedLoop(scenario, carrying_plan(), log=log, hardware=True)
        hardware.Close()
        record = robot.finish()

    assert isinstance(simulated.station, SimulatedStation)
    assert isinstance(hardware.station, HardwareStation)
    assert systems(hardware) == systems(simulated)
    assert wires(hardware.diagram) == wires(simulated.diagram)
    # Only the ports for which a real robot has no data are missing.
    inputs, outputs = ports(hardware.station)
    simulated_inputs, simulated_outputs = ports(simulated.station)
    assert inputs.keys() == simulated_inputs.keys() - {"applied_spatial_force"}
    truth = {"body_poses", "contact_results", "plant_state", "query_object"}
    assert outputs.keys() == simulated_outputs.keys() - truth
    # Building the diagram sends no commands.
    assert record["commanded"] == []
    assert record["hand_told"] == []
