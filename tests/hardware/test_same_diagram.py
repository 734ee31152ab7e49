"""Swapping the simulated station for the real one changes nothing above it."""

from pathlib import Path

import pytest
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


def wires(loop: ClosedLoop) -> set[tuple[str, str]]:
    return {
        (
            f"{source.get_name()}.{source.get_output_port(output).get_name()}",
            f"{sink.get_name()}.{sink.get_input_port(input_).get_name()}",
        )
        for (sink, input_), (source, output) in loop.diagram.connection_map().items()
    }


def ports(station: SimulatedStation | HardwareStation) -> set[str]:
    inputs = [station.get_input_port(k) for k in range(station.num_input_ports())]
    outputs = [station.get_output_port(k) for k in range(station.num_output_ports())]
    return {port.get_name() for port in (*inputs, *outputs)}


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
    assert wires(hardware) == wires(simulated)
    # Only the ports for which a real robot has no data are missing.
    assert ports(simulated.station) - ports(hardware.station) == {
        "applied_spatial_force",
        "body_poses",
        "contact_results",
        "plant_state",
        "query_object",
    }
    assert ports(hardware.station) <= ports(simulated.station)
    # Building the diagram sends no commands.
    assert record["commanded"] == []
    assert record["hand_told"] == []
